"""The drive of a robot that has none: it counts nothing, moves nothing, and says so."""

import math
from collections.abc import Sequence

from msgspec import Struct

from core.records import WheelCounts
from hw.device import DeviceStatus, Port

NOTHING = "no drive: nothing commands motors, and no wheels are counted"


class NoDriveOptions(Struct, frozen=True):
    """It has no keys of its own."""

    def describe(self) -> str:
        return "nothing commands motors"


class NoDrive:
    """Has the face of a drive. It is always as it should be, with a remark for who looks at it."""

    due_s = math.inf  # it never wants to be heard
    settled, has_heard, emergency_stop = True, False, False
    identity, trouble = "", NOTHING

    def __init__(self, port: Port) -> None:
        """`port`: one that leads nowhere."""
        self.port = port
        self.status = DeviceStatus("none", "running", NOTHING, hears_s=math.inf)

    def step(self, now_s: float) -> Sequence[WheelCounts]:
        return ()

    def drive(self, left: float, right: float) -> None: ...

    def hear(self, now_s: float) -> None: ...

    def keep(self, now_s: float) -> None: ...

    def stop(self) -> None: ...

    def measured(self) -> dict[str, float]:
        return {}
