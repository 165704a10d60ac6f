"""What a planner must do for what it knows: go, slow down or stop, and why.

Source: planner link, sections 3 (STOP_ZONE) and 5.
"""

from mapod_link.bodies import Pose, StopZone

Advice = tuple[str, str]  # "go" | "slow" | "stop"; why, "" for go
POSE_VALID, MAP_VALID, DROP_OFF, ATTITUDE_OUT, OPERATOR_STOP = (
    1 << 4,
    1 << 5,
    1 << 7,
    1 << 9,
    1 << 15,
)
ZONE_STALE_S = 0.35
RUNNING = (1, 2)  # modes in which a robot may move


def link_advice(pose: Pose | None, blank: bool, stale: bool, suspect: bool) -> Advice:
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


def zone_advice(zone: StopZone, now_s: float) -> Advice:
    """What the sender makes of its map itself, in the direction of the robot's way."""
    if now_s - zone.arrived_s > ZONE_STALE_S:
        return "stop", "stop zone stale"
    if zone.must_stop:
        return "stop", zone.words() if zone.causes else "the sender says stop"
    return ("slow", zone.words()) if zone.state == 2 else ("go", "")
