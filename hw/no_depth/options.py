"""The keys of no depth camera: none."""

import math

from msgspec import Struct


class NoDepthOptions(Struct, frozen=True):
    """It has no keys of its own."""

    @property
    def period_s(self) -> float:
        return math.inf

    def describe(self) -> str:
        return "there is none"
