"""A run while it goes: what the planner knows, where the robot truly is, why it stands.

In a terminal with colours it is a picture, else a line now and then. It holds the run back to real
time, or to so many times of it.
"""

import math
import time

import numpy as np
import numpy.typing as npt
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.style import Style
from rich.table import Table
from rich.text import Text

from tools.rig.runs.one_run import Run
from tools.rig.truth.contact import FRONT_M, REAR_M, SIDE_M
from tools.terminal.screen import BAD, GOOD, POOR, factor_for, half_blocks, has_screen, labelled

U8 = npt.NDArray[np.uint8]
DRAWN_S, LINE_S = 0.1, 2.0  # of real time, of simulated time
UNKNOWN, FREE, OBSTACLE, THING, ROBOT, GOAL, PERSON = range(7)
COLOURS = ("#1c1c24", "#1f7d3d", "#e02b2b", "#5a3a3a", "#ffae00", "#40c0ff", "#e060e0")
STYLES = [[Style(color=upper, bgcolor=lower) for lower in COLOURS] for upper in COLOURS]
THING_M, GOAL_M = 0.15, 0.3
PANEL_COLUMNS = 46
STATES = {"driving": GOOD, "arrived": GOOD, "idle": POOR, "stopped": BAD}


class Watcher:
    """A context; call it after every tick. speed: times real time; 0: as fast as it goes."""

    def __init__(self, console: Console, speed: float = 1.0) -> None:
        self._console, self._speed = console, speed
        self._live = Live(console=console, screen=True, auto_refresh=False)
        self._has_screen = has_screen(console)
        self._begun_s = self._drawn_s = time.monotonic()
        self._line_s = 0.0

    def __enter__(self) -> "Watcher":
        if self._has_screen:
            self._live.start()
        self._begun_s = time.monotonic()
        return self

    def __exit__(self, *what: object) -> None:
        if self._has_screen:
            self._live.stop()

    def __call__(self, run: Run) -> None:
        if self._speed > 0.0:
            ahead_s = run.since_begin_s / self._speed - (time.monotonic() - self._begun_s)
            if ahead_s > 0.01:
                time.sleep(ahead_s)
        if not self._has_screen:
            if run.since_begin_s >= self._line_s:
                self._line_s += LINE_S
                self._console.print(Text(line_of(run)), soft_wrap=True)
        elif time.monotonic() - self._drawn_s >= DRAWN_S:
            self._drawn_s = time.monotonic()
            self._live.update(picture(run, self._console), refresh=True)


def line_of(run: Run) -> str:
    (x, y, yaw), state = run.judge.truth.place, run.state
    words = f"{run.since_begin_s:6.1f} s  x {x:+.2f} y {y:+.2f} m {math.degrees(yaw):+.0f} deg  "
    words += f"{run.judge.v_mps:+.2f} m/s  goal {run.goals.at + 1} of {len(run.goals.all)}  "
    words += state.state + (f" ({state.why})" if state.why else "")
    blocked_by = run.loop.app.pilot.control.blocked_by
    return words + (f"; mapod: {blocked_by}" if blocked_by else "")


def image_of(run: Run) -> U8:
    """The app's map with what truly stands there, robot, goal and people: [row, column], x up."""
    grid, cells = run.loop.app.mapper.maps.window.grid, run.loop.map_now()
    image = np.full(cells.shape, UNKNOWN, dtype=np.uint8)
    image[cells == -1], image[cells == 1] = FREE, OBSTACLE
    i, j = grid.corner_i + np.arange(grid.size), grid.corner_j + np.arange(grid.size)
    x, y = np.meshgrid((i + 0.5) * grid.cell_m, (j + 0.5) * grid.cell_m)
    z = run.judge.truth.height_m
    there = run.scene.blocks(x.ravel(), y.ravel(), z + THING_M, z + 1.3).reshape(x.shape)
    image[there & (cells == 0)] = THING
    people = run.judge.truth.people
    for px, py, radius_m in [] if people is None else people.tolist():
        image[np.hypot(x - px, y - py) <= max(radius_m, grid.cell_m / 2)] = PERSON
    if run.goals.maybe_current is not None:
        gx, gy = np.clip(run.goals.maybe_current, (x.min(), y.min()), (x.max(), y.max()))
        image[np.hypot(x - gx, y - gy) <= GOAL_M] = GOAL  # a goal beyond, at the edge
    rx, ry, yaw = run.judge.truth.place
    c, s = math.cos(yaw), math.sin(yaw)
    ahead, left = c * (x - rx) + s * (y - ry), c * (y - ry) - s * (x - rx)
    image[(ahead > -REAR_M) & (ahead < FRONT_M) & (np.abs(left) < SIDE_M)] = ROBOT
    return np.ascontiguousarray(image.T[::-1, ::-1])


def panel(run: Run) -> list[Text]:
    judge, state, control = run.judge, run.state, run.loop.app.pilot.control
    x, y, yaw = judge.truth.place
    stops = run.watch.stops
    false = sum(stop.is_false for stop in stops)
    lines = [
        Text(f"{run.scene.name}, seed {run.spec.seed}", "bold"),
        legend(),
        labelled("time", f"{run.since_begin_s:.1f} s"),
        labelled("robot", f"x {x:+.2f}  y {y:+.2f} m  {math.degrees(yaw):+.0f}°"),
        labelled("", f"{judge.v_mps:+.2f} m/s  {judge.w_radps:+.2f} rad/s"),
        labelled(
            "goal", f"{run.goals.at + 1} of {len(run.goals.all)}, {run.goals.reached} reached"
        ),
        labelled("planner", f"{state.state} {state.why}".strip(), STATES.get(state.state, "")),
        labelled("asks", f"{state.v_mps:+.2f} m/s  {state.w_radps:+.2f} rad/s"),
        labelled("mapod", control.blocked_by or "no objection", POOR if control.blocked_by else ""),
        labelled("gap", f"least {judge.least_gap_m:.2f} m ({judge.nearest or 'nothing near'})"),
        labelled("stops", f"{len(stops)}, {false} before nothing", POOR if false else ""),
    ]
    for stop in stops[-3:]:
        why = f"{stop.why or 'no reason told'} ({stop.in_way or 'nothing there'})"
        lines.append(labelled("", f"{stop.at_s:.0f} s: {why}"))
    lines += [labelled("fault", said, POOR) for _, said in run.loop.happened[-3:]]
    lines += [labelled("contact", contact.words(), BAD) for contact in judge.collisions]
    return lines


def legend() -> Text:
    line = Text(no_wrap=True)
    for name, kind in (("free", FREE), ("obstacle", OBSTACLE), ("unseen", THING), ("goal", GOAL)):
        line.append("██", COLOURS[kind]).append(f" {name} ")
    return line


def picture(run: Run, console: Console) -> RenderableType:
    image, (columns, lines) = image_of(run), console.size
    factor = factor_for(image.shape, columns - PANEL_COLUMNS - 2, lines)
    table = Table.grid(padding=(0, 2))
    table.add_row(half_blocks(image[::factor, ::factor], STYLES), Group(*panel(run)[:lines]))
    return table
