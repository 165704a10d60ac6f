"""Whether a replay writes to each planner, byte for byte, what was written when it was recorded."""

from dataclasses import dataclass

from mapod_link import frames
from mapod_link.serial_line import Deframer

NAMES = {
    number: name
    for name, number in vars(frames).items()
    if name in {"GEOM", "POSE", "MAP", "DIGEST", "STOP_ZONE", "TILE"}
}


@dataclass(frozen=True, slots=True)
class Difference:
    """The first byte that is another one."""

    t_s: float  # host clock of the recording, of the call that wrote it
    byte: int  # of all that was written to this planner, from 0
    frame: str  # what kind of frame it lies in
    what: str


class PlannerCheck:
    """One planner's bytes, as recorded and as played, call by call."""

    def __init__(self, name: str, datagrams: bool) -> None:
        self.name, self._datagrams = name, datagrams
        self.recorded_bytes = self.played_bytes = 0
        self.first: Difference | None = None

    @property
    def is_identical(self) -> bool:
        return self.first is None

    def compare(
        self, t_s: float, recorded: list[bytes], played: list[bytes], *, is_cut: bool = False
    ) -> None:
        """What one call wrote.

        Args:
            is_cut: the recording ends within this call: what it does not have is not judged.
        """
        before = self.recorded_bytes
        self.recorded_bytes += sum(map(len, recorded))
        self.played_bytes += sum(map(len, played))
        if recorded == played or self.first is not None:
            return
        for one, other in zip(recorded, played, strict=False):
            if one != other:
                at = before + _common(one, other)
                kind = self._kind(one)
                self.first = Difference(t_s, at, kind, f"{kind} frame is another one")
                return
            before += len(one)
        if len(recorded) > len(played):
            kind = self._kind(recorded[len(played)])
            self.first = Difference(t_s, before, kind, f"{kind} frame was recorded and not played")
        elif not is_cut:
            kind = self._kind(played[len(recorded)])
            self.first = Difference(t_s, before, kind, f"{kind} frame was played and not recorded")

    def describe(self) -> str:
        """`planner: identical: 252210 bytes`; or from which byte on it differs."""
        if self.first is None:
            return f"{self.name}: identical: {self.recorded_bytes} bytes"
        return (
            f"{self.name}: differs from byte {self.first.byte} of {self.recorded_bytes} recorded: "
            f"a {self.first.what}"
        )

    def _kind(self, piece: bytes) -> str:
        found = [piece] if self._datagrams else Deframer().feed(piece)
        heads = [frame[0] & 15 for frame in found if frame]
        return NAMES.get(heads[0], f"type {heads[0]}") if heads else "damaged"


def _common(one: bytes, other: bytes) -> int:
    """How many bytes at their beginnings are the same."""
    shorter = min(len(one), len(other))
    return next((k for k in range(shorter) if one[k] != other[k]), shorter)
