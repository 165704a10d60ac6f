"""The live rig's picture: the map as it came over the link, robot and goal in it; words beside."""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.text import Text

from mapod_link.receiver import Receiver
from tools.cli.view import PICTURE_PERIOD_S, WAIT_S, zone_lines
from tools.rig.watch import beside, legend, stamp
from tools.terminal.planner_end import PlannerEnd
from tools.terminal.screen import status_lines

U8 = npt.NDArray[np.uint8]


def image_of(planner: Receiver, goal: tuple[float, float] | None) -> U8:
    """The window with robot and goal: [row, column], map x up, map y left; (0, 0) without one.

    Args:
        goal: (x, y) m, map frame; drawn at the edge where it lies beyond.
    """
    window, geom, origin = planner.window(), planner.geom, planner.origin
    if geom is None or origin is None or not window.size:
        return np.zeros((0, 0), np.uint8)
    i, j = origin[0] + np.arange(geom.width), origin[1] + np.arange(geom.height)
    x, y = np.meshgrid((i + 0.5) * geom.cell_m, (j + 0.5) * geom.cell_m)
    image, pose = window.copy(), planner.pose
    place = None if pose is None else (pose.x_m, pose.y_m, pose.yaw_rad)
    stamp(image, x, y, place, goal)
    return np.ascontiguousarray(image.T[::-1, ::-1])


def picture(
    planner: Receiver,
    goal: tuple[float, float] | None,
    lines: Sequence[Text],
    columns: int,
    rows: int,
) -> RenderableType:
    """Map and words, for a terminal of this size."""
    image = image_of(planner, goal)
    words = [*lines, legend()]
    if not image.size:
        return Group(Text("waiting for the map", "bold"), *words)
    return beside(image, words, columns, rows)


def show(
    end: PlannerEnd,
    console: Console,
    done: Callable[[float], bool],
    lines: Callable[[float], list[Text]],
    goal: Callable[[], tuple[float, float] | None],
) -> None:
    """The picture until `done(now_s)`; `lines(now_s)` stand above what the link tells."""
    with Live(console=console, screen=True, auto_refresh=False) as live:
        drawn_s = 0.0
        while not done(now_s := end.step(WAIT_S)):
            if now_s - drawn_s >= PICTURE_PERIOD_S:
                drawn_s, (columns, rows) = now_s, console.size
                told = [*lines(now_s), *zone_lines(end.planner.stop_zone, now_s)]
                told += status_lines(end.planner, end.meter, now_s)
                live.update(picture(end.planner, goal(), told, columns, rows), refresh=True)
