"""What the map is worth now: ages and states of the inputs to the health word of the planner link.

Source: planner link, section 3 (health bits, modes); design, section 8.
"""

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


def stale_s(period_s: float) -> float:
    """The age from which a scan is stale, of a scanner with that period."""
    return max(LINK_STALE_S, STALE_PERIODS * period_s)


def health_of(
    *,
    age_scan_s: float,  # of the newest scan in the map, its last beam; ages: inf = never
    age_scanner_s: float,  # of the newest scan that was delivered
    age_ahrs_s: float,
    age_wheels_s: float,
    scan_stale_s: float,
    clocks_locked: bool,
    pose_known: bool,
    map_begun: bool,
    overrun: bool,  # within the last second
    tilt_rad: float,  # the larger of |roll| and |pitch|
    replayed: bool,
    drop_ahead: bool,  # within the way to stop
    impaired: bool,  # the scanner sees worse than it should
    stop_asked: bool,  # the emergency stop is pressed
    stalled: bool,  # the wheels' counters do not follow what the wheels are told
) -> tuple[int, int]:
    """The health bits and the mode of the POSE frame, from the inputs at one instant.

    Booting until the map begins, then running or fault; free may be told where MAP_VALID is set.
    """
    ahrs = age_ahrs_s <= AHRS_STALE_S
    wheels = age_wheels_s <= WHEELS_STALE_S and not stalled
    level = tilt_rad <= MAX_SLOPE_RAD
    pose = ahrs and wheels and pose_known
    mapped = pose and age_scan_s <= scan_stale_s and level and map_begun
    word = (
        (SCANNER_OK if age_scanner_s <= scan_stale_s else 0)
        | (AHRS_OK if ahrs else 0)
        | (WHEELS_OK if wheels else 0)
        | (CLOCKS_LOCKED if clocks_locked else 0)
        | (POSE_VALID if pose else 0)
        | (MAP_VALID if mapped else 0)
        | (0 if overrun else NO_OVERRUN)
        | (DROP_AHEAD if drop_ahead else 0)
        | (SIGHT_IMPAIRED if impaired else 0)
        | (0 if level else TOO_STEEP)
        | (STOP_ASKED if stop_asked else 0)
    )
    if replayed:
        return word, REPLAYED
    if not map_begun:
        return word, BOOTING
    if not mapped:
        return word, FAULT
    return word, RUNNING if clocks_locked and not overrun else DEGRADED


DOUBTS = (
    (SCANNER_OK, causes.NO_SCANS),
    (AHRS_OK, causes.NO_ATTITUDE),
    (WHEELS_OK, causes.NO_COUNTS),
    (POSE_VALID, causes.NO_POSE),
    (MAP_VALID, causes.NOT_MAPPED),
)


def doubt(word: int) -> int:
    """The cause for which free is held back (`core.mapping.causes`), the first; 0: it is told."""
    if word & MAP_VALID:
        return 0
    if word & TOO_STEEP:
        return causes.TILTED
    return next(cause for bit, cause in DOUBTS if not word & bit)
