"""What a planner must do for what it knows: go, slow down or stop, and why.

Source: planner link, sections 3 (STOP_ZONE) and 5.
"""

from mapod_link.bodies import Pose, StopZone

Advice = tuple[str, str]  # "go" | "slow" | "stop"; why, "" for go
POSE_VALID, MAP_VALID, DROP_OFF = 1 << 4, 1 << 5, 1 << 7  # bits of POSE's health
ATTITUDE_OUT, OPERATOR_STOP = 1 << 9, 1 << 15
ZONE_STALE_S = 0.35
RUNNING = (1, 2)  # modes in which a robot may move
JUDGED = (1, 2, 3)  # states of a stop zone that speak of what is known


def advice_for(pose: Pose | None, blank: bool, stale: bool, suspect: bool) -> Advice:
    """Section 5's table, the strictest line first."""
    if blank or pose is None:
        return "stop", "no map yet"
    reasons = {
        "link stale": stale,
        f"mode {pose.mode}": pose.mode not in RUNNING,
        "pose not valid": not pose.health & POSE_VALID,
        "map not valid": not pose.health & MAP_VALID,
        "attitude out of range": bool(pose.health & ATTITUDE_OUT),
        "drop-off ahead": bool(pose.health & DROP_OFF),
        "operator stop": bool(pose.health & OPERATOR_STOP),
    }
    for why, holds in reasons.items():
        if holds:
            return "stop", why
    return ("slow", "a frame is missing") if suspect else ("go", "")


def allowed_mps(zone: StopZone | None, now_s: float) -> tuple[float, float]:
    """How fast the robot may go straight ahead and straight back, by the sender's own judgement.

    Nothing is allowed without a stop zone, by one older than 0.35 s, or where it says unknown.
    """
    if zone is None or now_s - zone.arrived_s > ZONE_STALE_S or zone.state not in JUDGED:
        return 0.0, 0.0
    return zone.allowed_ahead_mps, zone.allowed_behind_mps
