"""What one data message of an MTi says, whichever of the two forms it came in.

It refuses values that are not finite: an 8-bit checksum lets one damaged frame in 256 pass.

Source: MTi sheet, sections 4 and 5.
"""

import math
from typing import Any

from core.records import record
from hw.device import BadFrame
from hw.mti.numbers import Quaternion, Vector, maybe_orientation

MAX_RATE_RADPS = 100.0  # the fastest variant of the device ends at 21


@record()
class MtSample:
    """What one data message says; None where it is silent. Earth frame: x north, y west, z up."""

    counter: int | None = None  # 0..65535, +1 per sample
    fine_ticks: int | None = None  # 0.1 ms
    q_earth_sensor: Quaternion | None = None
    rate_radps: Vector | None = None
    accel_mps2: Vector | None = None  # includes gravity
    magnetic: Vector | None = None  # 1.0: the field at calibration
    temperature_c: float | None = None
    status: int | None = None


class SampleBuilder:
    """A sample while it is put together; the first thing that is wrong with it is kept."""

    def __init__(self) -> None:
        self._wrong = ""
        self._values: dict[str, Any] = {}

    def put(self, name: str, value: int) -> None:
        """A field that can't be wrong."""
        self._values[name] = value

    def take(self, name: str, values: tuple[float, ...]) -> None:
        """Numbers of a field: a single one, or a tuple of them."""
        if not all(map(math.isfinite, values)):
            self.reject(f"{name} is not finite")
        elif name == "rate_radps" and max(map(abs, values)) > MAX_RATE_RADPS:
            self.reject("rate of turn beyond any such device")
        self._values[name] = values if len(values) > 1 else values[0]

    def take_orientation(self, kind: int, values: tuple[float, ...], frame: int) -> None:
        """Quaternion, Euler angles or matrix, as they stand on the wire."""
        q = maybe_orientation(kind, values, frame)
        if q is None:
            self.reject("orientation is not a rotation")
        self._values["q_earth_sensor"] = q

    def reject(self, reason: str) -> None:
        """The message is worth nothing."""
        self._wrong = self._wrong or reason

    def sample(self, data: bytes) -> MtSample | BadFrame:
        """The sample, if nothing was wrong."""
        return BadFrame(self._wrong, data) if self._wrong else MtSample(**self._values)
