"""What the settings say of a camera: the keys that its driver alone knows. Its address is a port's.

Source: visionary sheet, sections 1, 3 and 4.
"""

from typing import Annotated, Literal

from msgspec import Meta, Struct

Level = Literal["none", "operator", "maintenance", "authorized_client", "service"]


class VisionaryOptions(Struct, frozen=True):
    """How a camera is spoken to, what is set in it, and which of its pixels are believed."""

    control: Literal["cola_2", "cola_b"]
    period_s: Annotated[float, Meta(ge=0.033, le=1.0)]  # between frames, as wanted
    level: Level  # who may set it; "none": it is left as it is
    password: Annotated[str, Meta(max_length=64)]
    min_confidence: Annotated[int, Meta(ge=0, le=65535)]  # where the camera tells a confidence
    latency_s: Annotated[float, Meta(ge=0, le=0.5)]  # from the middle of exposure to first byte

    @property
    def period_us(self) -> int:
        """As the camera takes it, not below its shortest."""
        return max(33_333, round(1e6 * self.period_s))

    def describe(self) -> str:
        spoken = {"cola_2": "CoLa-2", "cola_b": "CoLa-B"}[self.control]
        return f"depth camera by {spoken}, a frame each {1000 * self.period_s:.0f} ms"
