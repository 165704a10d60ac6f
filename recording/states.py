"""What a recording tells of the app now and then, beside its bytes: state, map and newest scan.

Compact records, taken at `[record] rate_hz`; `recording.foxglove` makes others' messages of them.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from core.records import U8, PoseReport, StopZoneReport

F32 = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class CellWindow:
    """The obstacle map as a receiver of the planner link has it, unrolled."""

    states: U8  # (rows, columns): 0 unknown, 1 free, 2 obstacle; row 0 has the lowest j
    corner_i: int  # world cell of states[0, 0]
    corner_j: int
    cell_m: float


@dataclass(frozen=True, slots=True, eq=False)
class StateRecord:
    """The app at one instant."""

    t_s: float  # host monotonic clock
    pose: PoseReport
    zone: StopZoneReport | None
    window: CellWindow | None  # None: there is no map yet
    height_m: F32 | None = None  # (rows, columns) of the window's cells; NaN: not known
    variance_m2: F32 | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ScanRecord:
    """The newest sweep: as the scanner sent it, and where its returns are."""

    t_s: float  # host monotonic clock, beam 0
    first_rad: float  # bearing of beam 0, counter-clockwise from straight ahead
    step_rad: float
    ranges_m: F32  # (n,) of the first echo; NaN: no measurement
    points_map: F32 | None  # (k, 3) metres, map frame; None: not worked out
