"""The planner of fakes/planner_mcu on this machine: its firmware's own sources, as an object.

It has no clock and draws no random numbers: the same bytes at the same times give the same frames.
"""

import ctypes
import functools
import math
from collections.abc import Mapping
from ctypes import c_int32 as i32
from ctypes import c_uint8 as u8
from ctypes import c_uint32 as u32
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from tools.rig.planner.build import PlannerRobot, build_planner_library, shipped_robot

U8 = npt.NDArray[np.uint8]
OUT_BYTES = 64
STATES = ("idle", "driving", "arrived", "stopped")
RECOVERIES = ("", "wait", "look", "back", "probe", "view", "face", "pass")
WHY = {  # `enum mapod_why`, and from 16 on `enum driver_why`
    0: "",
    1: "a frame is missing",
    2: "no map yet",
    3: "the link is stale",
    4: "mapod is not running as it should",
    5: "the emergency stop is pressed",
    6: "the pose is not valid",
    7: "the map is not valid",
    8: "the robot stands too steep for its map",
    9: "a drop-off is in the way",
    10: "the map is not the sender's",
    16: "the sender's stop zone is unknown or too old",
    17: "the sender's stop zone says stop",
    18: "waits for what is in the way",
    19: "ground in the way was not seen",
    20: "the robot does not obey",
    21: "turns to look around",
    22: "goes back to see the ground ahead",
    23: "goes to where the ground ahead can be seen",
    24: "no way over seen ground",
    25: "the goal is too near to an obstacle",
    26: "not there after the longest time",
    27: "the sender has started anew",
    28: "told to stop",
    29: "the window's cells are too many, too small or too large for the driver",
}


@dataclass(frozen=True, slots=True)
class PlannerSettings:
    """What the planner is told before it starts, and the robot that it is compiled for."""

    start_clear_m: float = 0.0  # radius about the map's origin that is assumed clear, 0 to 30
    unknown_mps: float = 0.0  # how fast it may enter ground not known to be free, 0 to 5; 0: never
    robot: PlannerRobot = field(default_factory=shipped_robot)

    def __post_init__(self) -> None:
        if not (0.0 <= self.start_clear_m <= 30.0 and 0.0 <= self.unknown_mps <= 5.0):
            raise ValueError(
                "a planner's settings: start_clear_m must be 0 to 30, unknown_mps 0 to 5: "
                f"they are {self.start_clear_m:g}, {self.unknown_mps:g}"
            )

    def thousandths(self) -> tuple[int, int]:
        """In mm and mm/s, in the order of `struct driver_settings`."""
        return round(self.start_clear_m * 1000), round(self.unknown_mps * 1000)


class PlannerState(Struct, frozen=True):
    """What the planner says of itself, SI, map frame."""

    state: str = "idle"  # or "driving", "arrived", "stopped"
    why: str = ""  # it stands, has stopped, or does not simply go on; "" for none
    v_mps: float = 0.0  # asked for
    w_radps: float = 0.0
    recovery: str = ""  # the behaviour where no path leads on; "": it follows its path
    goal: tuple[float, float] = (0.0, 0.0)
    blank: bool = False
    suspect: bool = False
    accepted: int = 0  # frames, since the start


def planner_state(told: Mapping[str, int]) -> PlannerState:
    return PlannerState(
        state=STATES[told["state"]],
        why=WHY[told["why"]],
        v_mps=told["v_mmps"] / 1000,
        w_radps=told["w_mradps"] / 1000,
        recovery=RECOVERIES[told["recovery"]],
        goal=(told["goal_x_mm"] / 1000, told["goal_y_mm"] / 1000),
        blank=bool(told["blank"]),
        suspect=bool(told["suspect"]),
        accepted=told["accepted"],
    )


class _Report(ctypes.Structure):
    """struct planner_report of fakes/planner_mcu/library.c."""

    _fields_ = (
        *((name, i32) for name in ("v_mmps", "w_mradps", "goal_x_mm", "goal_y_mm")),
        *((name, i32) for name in ("width", "height", "ox", "oy")),
        ("accepted", u32),
        *((name, u8) for name in ("state", "why", "recovery", "blank", "suspect")),
    )


@functools.cache
def library(robot: PlannerRobot) -> ctypes.CDLL:
    """The planner for a robot, compiled for this machine (see c_build), its calls typed."""
    lib = ctypes.CDLL(str(build_planner_library(robot)))
    handle, bytes_in = ctypes.c_void_p, ctypes.c_char_p
    lib.planner_new.argtypes = [ctypes.POINTER(i32), u32, bytes_in]
    lib.planner_new.restype = handle
    lib.planner_free.argtypes = [handle]
    lib.planner_datagram.argtypes = [handle, u32, bytes_in, u32]
    lib.planner_poll.argtypes = [handle, u32, bytes_in]
    lib.planner_poll.restype = u32
    lib.planner_goal.argtypes = [handle, i32, i32]
    lib.planner_halt.argtypes = [handle]
    lib.planner_report.argtypes = [handle, ctypes.POINTER(_Report)]
    lib.planner_window.argtypes = [handle, ctypes.c_void_p]
    return lib


class CPlanner:
    """The planner on a clock that the caller keeps; each one of a run has its own nonce."""

    def __init__(self, settings: PlannerSettings, nonce: int = 1) -> None:
        self._lib = library(settings.robot)
        self.settings = settings
        numbers = settings.thousandths()
        self._out = ctypes.create_string_buffer(OUT_BYTES)
        self._handle = self._lib.planner_new((i32 * len(numbers))(*numbers), nonce, None)
        assert self._handle

    def __del__(self) -> None:
        if getattr(self, "_handle", None):
            self._lib.planner_free(self._handle)

    def feed_datagram(self, now_s: float, data: bytes) -> bool:
        """One frame; whether it was accepted."""
        return bool(self._lib.planner_datagram(self._handle, _ms(now_s), data, len(data)) > 0)

    def poll(self, now_s: float) -> list[bytes]:
        """Frames to send: HELLO, ACK, DRIVE."""
        frames: list[bytes] = []
        while size := self._lib.planner_poll(self._handle, _ms(now_s), self._out):
            frames.append(self._out.raw[:size])
        return frames

    def goal(self, x_m: float, y_m: float) -> None:
        self._lib.planner_goal(self._handle, round(x_m * 1000), round(y_m * 1000))

    def halt(self) -> None:
        self._lib.planner_halt(self._handle)

    def state(self, now_s: float) -> PlannerState:
        report = self._report()
        return planner_state({name: getattr(report, name) for name, *_ in _Report._fields_})

    def snapshot(self) -> tuple[U8, tuple[int, int]]:
        """(height, width) copy of all cells: 0 unknown, 1 free, 2 obstacle; (0, 0) before any.
        And their lowest column and row in the endless grid, modulo 65 536 as int16."""
        report = self._report()
        cells: U8 = np.zeros((report.height, report.width), np.uint8)
        if cells.size:
            self._lib.planner_window(self._handle, cells.ctypes.data)
        return cells, (report.ox, report.oy)

    def _report(self) -> _Report:
        report = _Report()
        self._lib.planner_report(self._handle, ctypes.byref(report))
        return report


def _ms(now_s: float) -> int:
    return math.floor(now_s * 1000 + 1e-6) % 2**32
