"""What the settings say of an Xsens MTi: the keys of [ahrs] that its driver alone knows."""

from typing import Annotated

from msgspec import Meta, Struct


class MtiOptions(Struct, frozen=True):
    """How often it tells its orientation."""

    rate_hz: Annotated[float, Meta(ge=10, le=120)]

    def describe(self) -> str:
        return f"{self.rate_hz:g} samples/s"
