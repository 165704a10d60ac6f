"""What pages are told ten times a second: pose, health, stop zone, link."""

import math

from mapod_link.bodies import ZONE_STALE_S, ZONE_STATES, Pose, StopZone
from mapod_link.receiver import Receiver
from tools.terminal.planner_end import Meter
from tools.terminal.screen import MISSING, MODES, WARNINGS, link_words
from tools.view.link_end import LinkEnd

BOOTING = 0
SCANNER = 0  # bit of its health


def state_of(end: LinkEnd, now_s: float) -> dict[str, object]:
    """The message `state`, but for what differs from page to page."""
    receiver = end.receiver
    pose = receiver.pose
    mode = pose.mode if pose else BOOTING
    return {
        "type": "state",
        "t_s": now_s,
        "pose": pose_of(pose) if pose else None,
        "mode": mode,
        "mode_name": MODES[mode] if mode < len(MODES) else f"unknown ({mode})",
        "advice": receiver.advice(now_s),
        "inputs": inputs_of(pose, now_s, end.meter.scan_hz(now_s)) if pose else [],
        "health_bits": pose.health if pose else 0,
        "zone": zone_of(receiver.stop_zone, now_s) if receiver.stop_zone else None,
        "rates": rates_of(end.meter, now_s),
        "latency_ms": end.meter.recent_ms(),
        "link": link_of(end, now_s),
    }


def pose_of(pose: Pose) -> dict[str, float]:
    return {
        "x": pose.x_m, "y": pose.y_m, "yaw": pose.yaw_rad, "pitch": pose.pitch_rad,
        "roll": pose.roll_rad, "v": pose.v_mps, "w": pose.w_radps,
    }  # fmt: skip


def inputs_of(pose: Pose, now_s: float, scan_hz: float) -> list[dict[str, object]]:
    """The three devices with their ages as of now, then what else the health bits say."""
    heard_s = now_s - pose.arrived_s
    ages_s = (pose.age_scan_s, pose.age_ahrs_s, pose.age_enc_s)
    inputs: list[dict[str, object]] = []
    for bit, name in enumerate(MISSING):
        ok = bool(pose.health >> bit & 1)
        age_s = ages_s[bit] + heard_s if bit < len(ages_s) else None
        text = "" if ok else "not in time" if bit < len(ages_s) else "missing"
        if age_s is not None and math.isinf(age_s):
            age_s, text = None, "nothing for a second or longer"
        hz = scan_hz if bit == SCANNER else None
        inputs.append({"name": name, "ok": ok, "age_s": age_s, "hz": hz, "text": text})
    for bit, name in WARNINGS.items():
        if pose.health >> bit & 1:
            warning = {"name": name, "ok": False, "age_s": None, "hz": None, "text": "warning"}
            inputs.append(warning)
    return inputs


def zone_of(zone: StopZone, now_s: float) -> dict[str, object]:
    ahead_mps, behind_mps = zone.allowed_mps(now_s)
    age_s = now_s - zone.arrived_s
    old = age_s > ZONE_STALE_S  # it says nothing any more
    known = not old and zone.state < len(ZONE_STATES)
    return {
        "state": ZONE_STATES[zone.state] if known else "unknown",
        "causes": zone.causes,
        "text": f"not heard for {age_s:.1f} s" if old else zone.describe(),
        "free_ahead_m": 0.0 if old else zone.free_ahead_m,
        "free_behind_m": 0.0 if old else zone.free_behind_m,
        "allowed_ahead_mps": ahead_mps,
        "allowed_behind_mps": behind_mps,
        "nearest_m": None if old or math.isinf(zone.nearest_m) else zone.nearest_m,
        "bearing_rad": zone.bearing_rad,
    }


def rates_of(meter: Meter, now_s: float) -> dict[str, float]:
    maps_hz, poses_hz, bytes_per_s = meter.rates(now_s)
    return {"map_hz": maps_hz, "pose_hz": poses_hz, "bytes_s": bytes_per_s,
            "scan_hz": meter.scan_hz(now_s)}  # fmt: skip


def link_of(end: LinkEnd, now_s: float) -> dict[str, object]:
    receiver, numbers = end.receiver, end.receiver.numbers
    text = end.trouble or link_words(receiver, now_s)[0]
    return {
        "text": text,
        "stale": bool(end.trouble) or receiver.stale(now_s),
        "blank": receiver.blank,
        "age_s": age_of(receiver, now_s),
        "suspect": receiver.suspect,
        "lost": numbers.missing,
        "rejected": receiver.rejected.total(),
    }


def age_of(receiver: Receiver, now_s: float) -> float | None:
    """Since when nothing shown is known to be so; None: nothing has come."""
    if receiver.pose is None or math.isinf(receiver.numbers.map_s):
        return None
    return now_s - min(receiver.pose.arrived_s, receiver.numbers.map_s)
