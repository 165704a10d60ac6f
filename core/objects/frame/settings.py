"""The settings that the steps of a frame take; they stand with those of the settings file."""

from core.object_settings import FrameSettings

__all__ = ["FrameSettings"]
