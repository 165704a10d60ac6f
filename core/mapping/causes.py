"""Why a cell is what it is: one code for each rule that decides cells.

A code belongs to one state, so that a cause and the state that it explains can't contradict each
other. Codes are told on the planner link (TILE, layer cause): those that there are keep their
meaning. No kernel in here, so that who only reads codes need not load the compiler.
Source: design, section 7; planner link, section 3 (TILE).
"""

from typing import NamedTuple

from core.records import FREE, OBSTACLE, UNKNOWN

OUTSIDE = 0  # of the map: nothing is told
# why a cell is unknown
UNSEEN, GONE, UNSHOWN, CONTRADICTED, EARLIER_RUN, EDGE, FOOT, AGED, BEYOND_METHOD = range(1, 10)
UNKNOWN_BEFORE, GUESSED, UNREACHED, FEW, RESET, CORRUPT, UNCERTAIN, BESIDE = range(10, 18)
# why it is free
FLOOR, SOFT, PASSED, FLOOR_AGAIN, JUDGED_AGAIN, FREE_BEFORE = range(64, 70)
# why it is an obstacle
STANDS, LOW, NO_FLOOR, TOO_HIGH, TOO_LOW, OBSTACLE_BEFORE, BEYOND_STEP, BRINK = range(128, 136)
# why free is held back: the input that is not to be trusted
TILTED, NO_SCANS, NO_ATTITUDE, NO_COUNTS, NO_POSE, NOT_MAPPED = range(192, 198)
FIRST_FREE, FIRST_OBSTACLE, FIRST_DOUBT = 64, 128, 192
LOW_GROUND = frozenset((LOW, NO_FLOOR, TOO_LOW, BEYOND_STEP))  # a drop; others stand


class Cause(NamedTuple):
    """One rule, in a word and in a sentence."""

    word: str
    sentence: str


CAUSES = {
    UNSEEN: Cause("unseen", "No beam has met it, and no floor was missed in it."),
    GONE: Cause("gone", "What stood in it is gone, and its floor has not been seen."),
    UNSHOWN: Cause(
        "unshown",
        "Floor was due in it and did not show, in too few scans or parts of it for a drop; "
        "nothing was seen in it.",
    ),
    CONTRADICTED: Cause(
        "contradicted", "One scan speaks against floor, and too few have looked again since."
    ),
    EARLIER_RUN: Cause(
        "earlier-run", "It is known of a loaded map alone: no beam of this run has met its floor."
    ),
    EDGE: Cause(
        "edge", "It looks like floor, but is new, and what lies behind it has not been seen."
    ),
    FOOT: Cause(
        "foot", "Something in it rises or falls a little, and not all cells around it were seen."
    ),
    AGED: Cause("aged", "It was free, and no beam has met it or passed it for too long."),
    BEYOND_METHOD: Cause("beyond", "It lies outside of the map that the method keeps."),
    UNKNOWN_BEFORE: Cause(
        "before", "It was decided unknown before, and has not been touched by a beam since."
    ),
    GUESSED: Cause("guessed", "Something rises in it, over ground that is not known well enough."),
    UNREACHED: Cause(
        "unreached", "Its floor was seen, but not that it can be reached without a step."
    ),
    FEW: Cause("few", "Too few beams have passed low over its floor."),
    RESET: Cause("reset", "The last scan that met it disagrees with what was there before."),
    CORRUPT: Cause(
        "corrupt", "It departs from its neighbours and is not certain: a mixed pixel, perhaps."
    ),
    UNCERTAIN: Cause("uncertain", "It looks flat, but too few readings have agreed on it."),
    BESIDE: Cause("beside", "It looks flat, but what an obstacle beside it is may reach into it."),
    FLOOR: Cause("floor", "All that was seen in it lies within the bounds of floor."),
    SOFT: Cause(
        "soft", "What stands in it lets beams in, and is lower than the settings call free."
    ),
    PASSED: Cause(
        "passed", "Something stood in it; beams passed through there in many scans in a row."
    ),
    FLOOR_AGAIN: Cause(
        "floor-again", "Something low stood in it or floor lacked; floor alone was seen since."
    ),
    JUDGED_AGAIN: Cause(
        "judged-again", "It spoke against floor, and lies on the ground as it was found since."
    ),
    FREE_BEFORE: Cause(
        "before", "It was decided free before, and has not been touched by a beam since."
    ),
    STANDS: Cause("stands", "Two scans or more met something in it at the upper bound or higher."),
    LOW: Cause("low", "Two scans or more met something in it at the lower bound or lower."),
    NO_FLOOR: Cause(
        "no-floor", "Floor was due in so many parts of it and did not show: a drop, or black."
    ),
    TOO_HIGH: Cause("too-high", "Its height is at the upper bound of floor or above."),
    TOO_LOW: Cause("too-low", "Its height is at the lower bound of floor or below."),
    BEYOND_STEP: Cause("beyond-step", "Its ground lies beyond a step that no wheel climbs."),
    BRINK: Cause("brink", "It lies higher than a cell beside it by a bound of floor or more."),
    OBSTACLE_BEFORE: Cause(
        "before", "It was decided an obstacle before, and has not been touched by a beam since."
    ),
    TILTED: Cause("tilted", "Not trusted: the robot stands too steep for its map."),
    NO_SCANS: Cause("no-scans", "Not trusted: the scanner delivers no scans."),
    NO_ATTITUDE: Cause("no-attitude", "Not trusted: the attitude sensor delivers nothing."),
    NO_COUNTS: Cause(
        "no-counts",
        "Not trusted: what tells the place, counters or external poses, is silent or stands still.",
    ),
    NO_POSE: Cause("no-pose", "Not trusted: the pose is not known."),
    NOT_MAPPED: Cause("not-mapped", "Not trusted: no scan could be mapped lately."),
}


def state_of(cause: int) -> int:
    """The state that a cause explains; what is not trusted is UNKNOWN."""
    if cause < FIRST_FREE or cause >= FIRST_DOUBT:
        return UNKNOWN
    return OBSTACLE if cause >= FIRST_OBSTACLE else FREE


def shown_cause(cause: int, says: int, shown: int) -> int:
    """Why a cell is shown as it is: `cause` is what its rule says now, `says` the state of that.

    A cell is decided when a beam touches it. Until then it is shown as it was, though its
    neighbours or its age may say something else by now.
    """
    if says == shown:
        return cause
    if shown == UNKNOWN:
        return UNKNOWN_BEFORE
    return OBSTACLE_BEFORE if shown == OBSTACLE else FREE_BEFORE
