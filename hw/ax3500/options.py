"""What the settings say of a Roboteq AX3500: the keys of [drive] that its driver alone knows."""

from typing import Annotated, Literal

from msgspec import Meta, Struct


class Ax3500Options(Struct, frozen=True):
    """How often its counters are read, and how it is wired."""

    poll_hz: Annotated[float, Meta(ge=5, le=30)]
    left_channel: Literal[1, 2]
    right_channel: Literal[1, 2]
    invert: list[Literal[1, 2]]
    enter_rs232: bool

    def __post_init__(self) -> None:
        if self.left_channel == self.right_channel:
            raise ValueError(
                f"right_channel: must differ from left_channel = {self.left_channel}, "
                f"is {self.right_channel}"
            )

    def describe(self) -> str:
        return f"{self.poll_hz:g} pairs/s"
