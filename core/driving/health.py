"""What the map is worth now: ages and states of the inputs to the health word of the planner link.

Source: planner link, section 3 (health bits, modes); design, section 8.
"""

from msgspec import Struct

from core.mapping import causes
from core.mapping.method import MAX_SLOPE_RAD

LINK_STALE_S = 0.15  # one of the planner link's time-outs
STALE_PERIODS = 3  # of a scanner that is so slow that this is longer
AHRS_STALE_S = 0.15
WHEELS_STALE_S = 0.4  # an exchange at 9600 baud may need a second try

SCANNER_OK, AHRS_OK, WHEELS_OK, CLOCKS_LOCKED = 1 << 0, 1 << 1, 1 << 2, 1 << 3
POSE_VALID, MAP_VALID, NO_OVERRUN = 1 << 4, 1 << 5, 1 << 6
DROP_AHEAD, SIGHT_IMPAIRED, TOO_STEEP, STOP_ASKED = 1 << 7, 1 << 8, 1 << 9, 1 << 15
BOOTING, RUNNING, DEGRADED, FAULT, REPLAYED = 0, 1, 2, 3, 4


class Inputs(Struct, frozen=True):
    """What is known of the inputs at one instant; ages in seconds, inf = never."""

    age_scan_s: float  # of the newest scan in the map, its last beam
    age_scanner_s: float  # of the newest scan that was delivered
    age_ahrs_s: float
    age_wheels_s: float
    clocks_locked: bool
    pose_known: bool
    map_begun: bool
    overrun: bool  # within the last second
    tilt_rad: float  # the larger of |roll| and |pitch|
    replayed: bool
    drop_ahead: bool  # within the way to stop
    impaired: bool  # the scanner sees worse than it should
    stop_asked: bool  # the emergency stop is pressed
    scan_stale_s: float
    stalled: bool  # the wheels' counters do not follow what the wheels are told


def stale_s(period_s: float) -> float:
    """The age from which a scan is stale, of a scanner with that period."""
    return max(LINK_STALE_S, STALE_PERIODS * period_s)


def health_word(inputs: Inputs) -> int:
    """The health bits of the POSE frame."""
    scanner = inputs.age_scanner_s <= inputs.scan_stale_s
    mapped = inputs.age_scan_s <= inputs.scan_stale_s
    ahrs = inputs.age_ahrs_s <= AHRS_STALE_S
    wheels = inputs.age_wheels_s <= WHEELS_STALE_S and not inputs.stalled
    level = inputs.tilt_rad <= MAX_SLOPE_RAD
    pose = ahrs and wheels and inputs.pose_known
    return (
        (SCANNER_OK if scanner else 0)
        | (AHRS_OK if ahrs else 0)
        | (WHEELS_OK if wheels else 0)
        | (CLOCKS_LOCKED if inputs.clocks_locked else 0)
        | (POSE_VALID if pose else 0)
        | (MAP_VALID if pose and mapped and level and inputs.map_begun else 0)
        | (0 if inputs.overrun else NO_OVERRUN)
        | (DROP_AHEAD if inputs.drop_ahead else 0)
        | (SIGHT_IMPAIRED if inputs.impaired else 0)
        | (0 if level else TOO_STEEP)
        | (STOP_ASKED if inputs.stop_asked else 0)
    )


def trusted(word: int) -> bool:
    """Whether "free" may be told at all."""
    return bool(word & MAP_VALID)


DOUBTS = (
    (SCANNER_OK, causes.NO_SCANS),
    (AHRS_OK, causes.NO_ATTITUDE),
    (WHEELS_OK, causes.NO_COUNTS),
    (POSE_VALID, causes.NO_POSE),
    (MAP_VALID, causes.NOT_MAPPED),
)


def doubt(word: int) -> int:
    """The cause for which free is held back (`core.mapping.causes`), the first; 0: it is told."""
    if trusted(word):
        return 0
    if word & TOO_STEEP:
        return causes.TILTED
    return next(cause for bit, cause in DOUBTS if not word & bit)


def mode(word: int, inputs: Inputs) -> int:
    """The mode of the POSE frame: booting until the map begins, then running or fault."""
    if inputs.replayed:
        return REPLAYED
    if not inputs.map_begun:
        return BOOTING
    if not word & MAP_VALID:
        return FAULT
    return RUNNING if word & CLOCKS_LOCKED and word & NO_OVERRUN else DEGRADED
