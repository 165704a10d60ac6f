"""The settings of the map of objects, which are in the settings file, and of the quick look."""

from typing import Annotated

from msgspec import Meta, Struct

from core.object_settings import ObjectMapSettings

__all__ = ["ObjectMapSettings", "QuickCheckSettings"]


class QuickCheckSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """The quick look: some rays of a frame against the map, instead of the whole frame."""

    rays: Annotated[int, Meta(ge=50, le=200)]
    max_range_m: Annotated[float, Meta(gt=0, le=100)]  # nothing is expected or compared beyond
    tolerance_m: Annotated[float, Meta(gt=0, le=1)]  # a range may differ so much
    most_unknown: Annotated[float, Meta(ge=0, le=1)]  # share of rays without a measurement
    every_frames: Annotated[int, Meta(ge=1, le=1000)]  # a whole frame at least so often
