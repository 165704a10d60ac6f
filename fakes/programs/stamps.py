"""When the fakes measured what, and when its last byte went onto the wire: a text file for meters.

    scan 1234.515000 1234.515302

A line each: what (`scan`, `attitude`), the instant that was measured last in it, and the instant at
which its last byte was about to be handed to the system; host monotonic seconds. Refuses to guess:
it wants fakes whose bytes no fault disturbs.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fakes.mti.stream import LATENCY_S
from fakes.scenes.scene import Scene
from fakes.world.error_models import ErrorModels
from fakes.world.world import F64, World

KEPT = 64  # instants that are not on the wire yet
SCAN = b"sSN LMDscandata"
MT_START, MT_DATA = b"\xfa\xff", (0x32, 0x36)
BITS_A_BYTE, ROUNDING_S = 10, 1e-4


class WatchedWorld(World):
    """A world that remembers the instants at which sensors looked at it, oldest first."""

    def __init__(
        self, scene: Scene | str | Path, seed: int, errors: ErrorModels | None = None
    ) -> None:
        self.swept_s: deque[float] = deque(maxlen=KEPT)  # last beam of each sweep
        self.sampled_s: deque[float] = deque(maxlen=KEPT)  # of the attitude sensor
        super().__init__(scene, seed, errors)
        self.swept_s.clear()  # it has looked at itself, to warm up
        self.sampled_s.clear()

    def motion_at(self, t_s: float) -> tuple[F64, F64, F64]:
        """As the base."""
        if not self.sampled_s or t_s > self.sampled_s[-1]:
            self.sampled_s.append(t_s)
        return super().motion_at(t_s)

    def ranges_m(self, times_s: F64, bearings_rad: F64) -> F64:
        """As the base."""
        self.swept_s.append(float(times_s[-1]))
        return super().ranges_m(times_s, bearings_rad)


class Stamps:
    """The clock to stamp by, and the lines so far: kept in memory, for a disk may be slow."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.lines: list[str] = []
        self._clock = clock

    def note(self, what: str, count: int, measured_s: Iterable[float], latest_s: float) -> None:
        """So many go onto the wire now: the newest measured at `latest_s` or before."""
        now_s = self._clock()
        for instant_s in [t_s for t_s in measured_s if t_s <= latest_s][-count:]:
            self.lines.append(f"{what} {instant_s:.6f} {now_s:.6f}\n")


class StampedScanner:
    """A fake scanner whose scans are stamped as they leave; all else is the fake's own."""

    def __init__(self, fake: Any, swept_s: deque[float], stamps: Stamps) -> None:
        self._fake, self._swept_s, self._stamps = fake, swept_s, stamps

    def __getattr__(self, name: str) -> Any:
        return getattr(self._fake, name)

    def connect(self, now_s: float) -> "StampedScanner | None":
        """One client more, stamped as well."""
        guest = self._fake.connect(now_s)
        return guest and StampedScanner(guest, self._swept_s, self._stamps)

    def exchange(self, now_s: float, received: bytes) -> bytes:
        """As the fake's."""
        sent: bytes = self._fake.exchange(now_s, received)
        if count := sent.count(SCAN):
            self._stamps.note("scan", count, self._swept_s, now_s)
        return sent


class StampedAttitude:
    """A fake attitude sensor whose data messages are stamped as their last bytes leave."""

    def __init__(self, fake: Any, sampled_s: deque[float], stamps: Stamps) -> None:
        self._fake, self._sampled_s, self._stamps = fake, sampled_s, stamps
        self._rest = b""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._fake, name)

    def exchange(self, now_s: float, received: bytes) -> bytes:
        """As the fake's."""
        sent: bytes = self._fake.exchange(now_s, received)
        self._rest += sent
        sizes = list(self._data_messages()) if sent else []
        if sizes:
            line_s = sizes[-1] * BITS_A_BYTE / self._fake.baud
            latest_s = now_s - LATENCY_S - line_s + ROUNDING_S
            self._stamps.note("attitude", len(sizes), self._sampled_s, latest_s)
        return sent

    def _data_messages(self) -> Iterator[int]:
        """Takes whole messages from the front of what was sent; the sizes of those with data."""
        while (start := self._rest.find(MT_START)) >= 0:
            self._rest = self._rest[start:]
            if len(self._rest) < 4 or len(self._rest) < (size := 5 + self._rest[3]):
                return
            if self._rest[2] in MT_DATA:
                yield size
            self._rest = self._rest[size:]


@contextmanager
def stamps_in(path: Path, clock: Callable[[], float]) -> Iterator[Stamps]:
    """Stamps that are in the file once the block has ended."""
    stamps = Stamps(clock)
    with path.open("w", encoding="ascii") as out:
        try:
            yield stamps
        finally:
            out.writelines(stamps.lines)
