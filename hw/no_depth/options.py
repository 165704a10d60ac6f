"""The keys of no depth camera: none."""

from msgspec import Struct


class NoDepthOptions(Struct, frozen=True):
    """It has no keys of its own."""

    def describe(self) -> str:
        return "there is none"
