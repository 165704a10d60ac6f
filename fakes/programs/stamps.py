"""When the fake scanner's sweeps left it: a text file for meters.

    scan 1234.515000 1234.515302

A line each: the instant of the last beam, and the instant at which the last byte was about to be
handed to the system; host monotonic seconds. Refuses to guess: it wants fakes whose bytes no fault
disturbs.
"""

from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fakes.scenes.scene import Scene
from fakes.world.error_models import ErrorModels
from fakes.world.robot import BODY, MOUNT, Body, Mount
from fakes.world.world import F64, World

KEPT = 64  # instants that are not on the wire yet
SCAN = b"sSN LMDscandata"


class WatchedWorld(World):
    """A world that remembers the instants at which the scanner looked at it, oldest first."""

    def __init__(
        self,
        scene: Scene | str | Path,
        seed: int,
        errors: ErrorModels | None = None,
        mount: Mount = MOUNT,
        body: Body = BODY,
    ) -> None:
        self.swept_s: deque[float] = deque(maxlen=KEPT)  # last beam of each sweep
        super().__init__(scene, seed, errors, mount, body)
        self.swept_s.clear()  # it has looked at itself, to warm up

    def ranges_m(self, times_s: F64, bearings_rad: F64) -> F64:
        self.swept_s.append(float(times_s[-1]))
        return super().ranges_m(times_s, bearings_rad)


class StampedScanner:
    """A fake scanner whose scans are stamped as they leave; all else is the fake's own.

    Args:
        swept_s: when the world was looked at.
        lines: takes the stamps; to be written at the end, for a disk may be slow.
    """

    def __init__(
        self, fake: Any, swept_s: deque[float], lines: list[str], clock: Callable[[], float]
    ) -> None:
        self._fake, self._swept_s, self._lines, self._clock = fake, swept_s, lines, clock

    def __getattr__(self, name: str) -> Any:
        return getattr(self._fake, name)

    def connect(self, now_s: float) -> "StampedScanner | None":
        guest = self._fake.connect(now_s)
        return guest and StampedScanner(guest, self._swept_s, self._lines, self._clock)

    def exchange(self, now_s: float, received: bytes) -> bytes:
        sent: bytes = self._fake.exchange(now_s, received)
        if count := sent.count(SCAN):
            left_s = self._clock()
            measured_s = [t_s for t_s in self._swept_s if t_s <= now_s][-count:]
            self._lines += [f"scan {t_s:.6f} {left_s:.6f}\n" for t_s in measured_s]
        return sent
