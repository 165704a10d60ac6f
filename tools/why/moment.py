"""The app of a recording, asked at one moment: what it knew, and what it let the robot do.

All of it is plain numbers and words, so that it can be written as JSON. `Watch` plays the recording
and keeps what a moment can't tell by itself: when things became as they are, and why.
"""

import math
from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np

from app import App
from core.driving import health
from core.driving.stop_zone import Obstruction, cells_near
from core.mapping.causes import CAUSES, OUTSIDE
from core.mapping.method import is_low
from core.records import FREE, OBSTACLE, DriveRequest, PoseReport
from mapod_link.bodies import ZONE_CAUSES, ZONE_STATES
from tools.replay.player import Player
from tools.why.beams import Cell, CellWatch
from tools.why.words import STATES, describe_cell, word_of

MODES = ("booting", "running", "degraded", "fault", "replayed")
EVENTS_KEPT = 12
NEAREST_TOLD = 5
LAYERS = ("height", "variance", "age", "z", "slope")


class Watch:
    """A recording under way to a moment, and what changed until then."""

    def __init__(self, player: Player, cell: Cell | None) -> None:
        self.player, self.app = player, player.app
        self.cell = CellWatch(self.app, cell) if cell else None
        self.stops: deque[dict[str, Any]] = deque(maxlen=EVENTS_KEPT)
        self.restarts: deque[dict[str, Any]] = deque(maxlen=EVENTS_KEPT)
        self.reasons: dict[str, set[str]] = {name: set() for name in self.app.states.statuses}
        self._stopped_by = ""
        self._states: dict[str, tuple[str, str]] = {}
        self._begun = (0, self.app.planners.session)

    def steps_until(self, t_s: float) -> Iterator[float]:
        """Play up to then, call by call: the instant of each. Raises RecordingError."""
        for now_s in self.player.steps_until(t_s):
            self._look(now_s)
            yield now_s

    def _look(self, now_s: float) -> None:
        app = self.app
        if self.cell is not None:
            self.cell.look(now_s)
        reason = app.pilot.control.blocked_by
        if reason != self._stopped_by:
            self._stopped_by = reason
            bars = cell_facts(app, barrier(app, now_s)) if "in the way" in reason else None
            self.stops.append({"t_s": now_s, "reason": reason, "cell": bars})
        for name, status in app.states.statuses.items():
            self.reasons[name].update(bad.reason for bad in status.rejections)
            state = (status.state, status.cause)
            if self._states.get(name) != state:
                if self._states.get(name, ("", ""))[0] == "running" != state[0]:
                    about = f"the {name} is {status.state}: {status.cause}"
                    self.restarts.append({"t_s": now_s, "what": about})
                self._states[name] = state
        begun = (app.mapper.counts.erased, app.planners.session)
        if begun != self._begun:
            if begun[0] != self._begun[0]:
                about = f"the map was begun anew: {app.mapper.odometry.broken_by}"
                self.restarts.append({"t_s": now_s, "what": about})
            if begun[1] != self._begun[1]:
                about = f"a new session of the planner link: {app.planners.renewed_because}"
                self.restarts.append({"t_s": now_s, "what": about})
            self._begun = begun


def request_of(app: App, now_s: float) -> DriveRequest | None:
    """What somebody asks of the robot now, if anybody does."""
    newest = app.planners.requests.newest
    return newest if newest is not None and now_s <= newest.valid_until_s else None


def obstruction(app: App, now_s: float) -> Obstruction | None:
    """What ends the way that the robot takes, is asked to take, or else that straight ahead."""
    control, pose = app.pilot.control, app.mapper.maybe_pose(now_s)
    if pose is None:
        return None
    odometry, robot = app.mapper.odometry, app.config.robot
    motion = control.heading_for((odometry.v_mps, odometry.w_radps), request_of(app, now_s))
    motion = motion if any(motion) else (robot.max_speed_mps, 0.0)
    full_mps = control.zone.rate_mps(*control.at_full_speed(motion))
    found = control.look(pose, motion, full_mps)
    return None if math.isinf(found.free_m) else found


def barrier(app: App, now_s: float) -> Cell | None:
    """The cell that ends that way."""
    found = obstruction(app, now_s)
    return None if found is None else (found.i, found.j)


def near_cells(app: App, now_s: float) -> list[Cell]:
    """The cells within the robot's margin that bar a way, the nearest first."""
    pose = app.mapper.maybe_pose(now_s)
    if pose is None:
        return []
    control, window = app.pilot.control, app.mapper.maps.window
    zone, grid = control.zone, window.grid
    place = (pose.x_m, pose.y_m, pose.yaw_rad)
    frame = (grid.corner_i, grid.corner_j, grid.size)
    near = cells_near(
        window.cells, frame, grid.cell_m, place, zone.rect, zone.margin_m, control.clear
    )
    middles = [((i + 0.5) * grid.cell_m, (j + 0.5) * grid.cell_m) for i, j, _ in near.tolist()]
    order = np.argsort([math.dist(middle, place[:2]) for middle in middles], kind="stable")
    return [(int(near[k, 0]), int(near[k, 1])) for k in order]


def cell_facts(app: App, cell: Cell | None) -> dict[str, Any] | None:
    """One cell: what it is, and by which rule."""
    if cell is None:
        return None
    maps, cell_m = app.mapper.maps, app.config.map.cell_m
    i, j = np.array([cell[0]]), np.array([cell[1]])

    def value(name: str) -> float | None:
        values = app.mapper.maybe_values(name, i, j)
        return None if values is None or math.isnan(values[0]) else float(values[0])

    cause = int(value("cause") or OUTSIDE)
    known = {name: value(name) for name in LAYERS}
    sure = (math.nan if number is None else number for number in known.values())
    height_m, variance_m2, age_s, *_ = sure
    facts: dict[str, Any] = {
        "i": cell[0],
        "j": cell[1],
        "x_m": round((cell[0] + 0.5) * cell_m, 3),
        "y_m": round((cell[1] + 0.5) * cell_m, 3),
        "state": STATES[int(value("state") or 0)],
        "cause": cause,
        "word": word_of(cause),
        "text": describe_cell(cause, age_s, height_m, variance_m2),
        **known,
    }
    if app.tiles.doubt and facts["state"] == STATES[FREE]:
        facts["told"] = f"unknown ({CAUSES[app.tiles.doubt].sentence})"
    if cause != OUTSIDE:
        facts["counts"] = maps.evidence(*cell)
    return facts


def inputs_of(watch: Watch, now_s: float, told: PoseReport) -> list[dict[str, Any]]:
    """Each device and planner: state, cause, age of what it told last."""
    app = watch.app
    ages_s = {"scanner": now_s - app.mapper.delivered_scan_s, "ahrs": told.age_ahrs_s}
    ages_s["drive"] = told.age_enc_s
    inputs: list[dict[str, Any]] = []
    for name, status in app.states.statuses.items():
        inputs.append({"name": name, "state": status.state, "cause": status.cause})
        inputs[-1] |= {"age_s": _finite(ages_s.get(name, math.inf)), "losses": status.losses}
        inputs[-1] |= {"frames_rejected": status.rejected}
        inputs[-1]["reasons"] = sorted(watch.reasons[name])
    for number, link in enumerate(app.planners.links, 1):
        name = "planner" if number == 1 else f"planner {number}"
        cause = link.wire.port.cause or link.peer.refusal
        state = "heard" if link.heard(now_s) else "silent"
        counters = link.counters
        inputs.append({"name": name, "state": state, "cause": cause, "age_s": None})
        inputs[-1] |= {"losses": 0, "frames_rejected": counters.answers_rejected}
        why = [counters.rejected_because] if counters.rejected_because else []
        inputs[-1]["reasons"] = why
    return inputs


def zone_of(app: App) -> dict[str, Any]:
    zone = app.pilot.zone
    causes = [name for bit, name in enumerate(ZONE_CAUSES) if zone.causes >> bit & 1]
    return {
        "state": ZONE_STATES[zone.state],
        "causes": causes,
        "free_ahead_m": _finite(zone.free_ahead_m),
        "free_behind_m": _finite(zone.free_behind_m),
        "allowed_ahead_mps": zone.allowed_ahead_mps,
        "allowed_behind_mps": zone.allowed_behind_mps,
        "nearest_m": _finite(zone.nearest_m),
        "bearing_deg": round(math.degrees(zone.bearing_rad), 1),
    }


def stands_of(watch: Watch, now_s: float) -> dict[str, Any]:
    """What the robot is asked, why it does not move, and which cells are in its way."""
    app = watch.app
    request, requests, found = (
        request_of(app, now_s),
        app.planners.requests,
        obstruction(app, now_s),
    )
    asked = None
    if request is not None:
        asked = {"v_mps": request.v_mps, "w_radps": request.w_radps, "by": requests.driver}
        asked["left_s"] = round(request.valid_until_s - now_s, 3)
    near = near_cells(app, now_s)
    bars = None
    if found is not None:
        bars = cell_facts(app, (found.i, found.j))
        assert bars is not None
        bars["free_m"] = round(found.free_m, 3)
        is_drop = found.state == OBSTACLE and is_low(app.mapper.maps, found.i, found.j)
        bars["is_drop"] = is_drop
    control = app.pilot.control
    return {
        "may_move": app.config.robot.enable_motors,
        "reason": control.blocked_by,
        "asked": asked,
        "commanded": {"v_mps": control.v_mps, "w_radps": control.w_radps},
        "way_ends_at": bars,
        "within_margin": len(near),
        "nearest": [cell_facts(app, cell) for cell in near[:NEAREST_TOLD]],
        "stops": list(watch.stops),
    }


def refusals_of(app: App) -> dict[str, dict[str, int]]:
    """How often what was refused since the begin, and why."""
    counts, outliers = app.mapper.counts, app.mapper.odometry.outliers
    scans = {
        "no attitude or pose came in time": counts.scans_dropped,
        "the robot leant too far for a map": counts.scans_tilted,
        "there was no pose yet": counts.scans_early,
    }
    poses = dict(app.planners.external_poses.refused)
    if outliers:
        poses["it does not fit the odometry"] = outliers
    return {
        "drive requests": dict(app.planners.requests.refused),
        "external poses": poses,
        "scans": {why: count for why, count in scans.items() if count},
    }


def moment_of(watch: Watch) -> dict[str, Any]:
    """All of it, as of the newest call of the app."""
    app, now_s = watch.app, watch.player.now_s
    _, told = app.report(now_s)
    pose = app.mapper.maybe_pose(now_s)
    where = None
    if pose is not None:
        where = {"x_m": round(told.x_m, 3), "y_m": round(told.y_m, 3)}
        where |= {f"{name}_deg": round(math.degrees(angle), 2) for name, angle in _angles(told)}
        where |= {"v_mps": round(told.v_mps, 3), "w_radps": round(told.w_radps, 3)}
    lacks = [text for bit, text in LACKS if not told.health & bit]
    lacks += [text for bit, text in HAS if told.health & bit]
    lacks += [text for text in (app.devices.scanner.doubt, app.devices.drive.trouble) if text]
    return {
        "pose": where,
        "mode": MODES[told.mode],
        "health": told.health,
        "doubts": list(dict.fromkeys(lacks)),
        "inputs": inputs_of(watch, now_s, told),
        "zone": zone_of(app),
        "stands": stands_of(watch, now_s),
        "restarts": list(watch.restarts),
        "refusals": refusals_of(app),
    }


LACKS = (
    (health.SCANNER_OK, "the scanner delivers no scans"),
    (health.AHRS_OK, "the attitude sensor delivers nothing"),
    (
        health.WHEELS_OK,
        "what tells the place is not heard or stands still: counters, or external poses",
    ),
    (health.CLOCKS_LOCKED, "the sensors' clocks are not locked"),
    (health.POSE_VALID, "the pose is not known"),
    (health.MAP_VALID, "the map is not valid"),
    (health.NO_OVERRUN, "the loop was too late within the last second"),
)
HAS = (
    (health.DROP_AHEAD, "a drop is on the way to a stop"),
    (health.SIGHT_IMPAIRED, "the scanner sees worse than it should"),
    (health.TOO_STEEP, "the robot stands too steep for its map"),
    (health.STOP_ASKED, "the emergency stop is pressed"),
)


def _angles(told: PoseReport) -> list[tuple[str, float]]:
    return [("yaw", told.yaw_rad), ("pitch", told.pitch_rad), ("roll", told.roll_rad)]


def _finite(number: float) -> float | None:
    """JSON knows no infinity: what was never, or is nowhere, is null."""
    return round(number, 3) if math.isfinite(number) else None
