"""Draws what a planner knows: the obstacle map, the robot in it, and how well both are. Draws only.

Map x, where the robot's nose pointed when the run began, is up; map y is left.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from rich.console import Console, Group, RenderableType
from rich.style import Style
from rich.table import Table
from rich.text import Text

from mapod_link.bodies import FREE, OBSTACLE, UNKNOWN, Pose
from mapod_link.receiver import Receiver
from tools.terminal.outlines import (
    MOVING,
    OBJECT,
    PATH,
    Lines,
    lines_of,
    objects_words,
    path_words,
)
from tools.terminal.planner_end import Delays, Meter

U8 = npt.NDArray[np.uint8]
ROBOT = 3  # drawn over the cells
COLOURS = {
    UNKNOWN: "#1c1c24", FREE: "#1f9d4d", OBSTACLE: "#e02b2b", ROBOT: "#ffae00",
    OBJECT: "#b98cff", MOVING: "#ff5fd2", PATH: "#6cc7ff",
}  # fmt: skip
HALVES = [[Style(color=COLOURS[a], bgcolor=COLOURS[b]) for b in COLOURS] for a in COLOURS]
ARROW_STYLE = Style(color="#000000", bgcolor=COLOURS[ROBOT], bold=True)
GOOD, POOR, BAD, LABEL = "green", "yellow", "bold red", "bright_black"
WORST_LAST = (FREE, UNKNOWN, OBSTACLE)
ROBOT_RADIUS_M = 0.3
ARROWS = "↑↖←↙↓↘→↗"  # counter-clockwise from map x
LETTERS = "^<v>"
SIGNS = " .#^om*"  # by class, and by what is drawn over it
NO_LINES = Lines()
PANEL_COLUMNS = 44
MODES = ("booting", "running", "degraded", "fault", "replayed or simulated data")
MISSING = ("scanner", "attitude sensor", "encoders", "clock lock", "pose", "map", "pace")
WARNINGS = {
    7: "drop-off ahead",
    8: "scanner window dirty",
    9: "attitude too steep",
    15: "stop asked",
}


@dataclass(frozen=True, slots=True)
class Robot:
    """Where it stands in the window."""

    col: float  # cells from the window's lowest corner, along map x
    row: float  # along map y
    yaw_rad: float
    radius: float  # cells


def maybe_robot(planner: Receiver) -> Robot | None:
    """None while there is no pose, or no window for it."""
    if planner.pose is None or planner.origin is None or planner.geom is None:
        return None
    return robot_in_window(planner.pose, planner.origin, planner.geom.cell_m)


def robot_in_window(pose: Pose, origin: tuple[int, int], cell_m: float) -> Robot:
    col, row = pose.x_m / cell_m - origin[0], pose.y_m / cell_m - origin[1]
    return Robot(col, row, pose.yaw_rad, ROBOT_RADIUS_M / cell_m)


# The map


def image_from_window(window: U8) -> U8:
    """(width, height) of a (height, width) window: first row farthest along x, first column y."""
    return window.T[::-1, ::-1]


def downsampled(image: U8, factor: int) -> U8:
    """Blocks of factor x factor as one cell of their worst class: obstacle, unknown, free."""
    if factor == 1:
        return image
    rank = np.argsort(WORST_LAST).astype(np.uint8)[image]
    rows, cols = (-(-side // factor) for side in image.shape)
    padded = np.zeros((rows * factor, cols * factor), np.uint8)  # with the best class
    padded[: image.shape[0], : image.shape[1]] = rank
    worst = padded.reshape(rows, factor, cols, factor).max(axis=(1, 3))
    classes: U8 = np.array(WORST_LAST, np.uint8)[worst]
    return classes


def factor_for(shape: tuple[int, int], columns: int, lines: int) -> int:
    """How many cells become one so that an image fits, two rows a line."""
    across, along = -(-shape[1] // max(columns, 1)), -(-shape[0] // max(2 * lines, 1))
    return max(1, across, along)


def cell_of_robot(robot: Robot, shape: tuple[int, int], factor: int) -> tuple[int, int]:
    """(row, column) of its cell in a downsampled image; `shape` is the image's before that."""
    row, col = shape[0] - 1 - math.floor(robot.col), shape[1] - 1 - math.floor(robot.row)
    return row // factor, col // factor


def map_text(window: U8, robot: Robot | None, factor: int = 1, lines: Lines = NO_LINES) -> Text:
    full = image_from_window(window)
    image = downsampled(full, factor).copy()
    lines.draw(image, window.shape, factor)
    if robot is None:
        return half_blocks(image, HALVES)
    row, col = cell_of_robot(robot, full.shape, factor)
    rows, cols = np.ogrid[: image.shape[0], : image.shape[1]]
    image[np.hypot(rows - row, cols - col) <= robot.radius / factor] = ROBOT
    return half_blocks(
        image, HALVES, (row // 2, col, ARROWS[round(robot.yaw_rad / (math.pi / 4)) % 8])
    )


def half_blocks(
    image: U8, styles: Sequence[Sequence[Style]], mark: tuple[int, int, str] | None = None
) -> Text:
    """Two rows a line; styles by upper and lower kind; mark: line, column, character."""
    if len(image) % 2:
        image = np.vstack([image, np.zeros((1, image.shape[1]), np.uint8)])
    text = Text(no_wrap=True, overflow="crop")
    for line, (upper, lower) in enumerate(zip(image[::2], image[1::2], strict=True)):
        edges = np.flatnonzero((np.diff(upper) != 0) | (np.diff(lower) != 0)) + 1
        cuts = {0, *edges.tolist(), len(upper)}
        if mark is not None and line == mark[0] and 0 <= mark[1] < len(upper):
            cuts |= {mark[1], mark[1] + 1}
        for first, end in pairwise(sorted(cuts)):
            if mark is not None and (line, first) == mark[:2]:
                text.append(mark[2], ARROW_STYLE)
            else:
                half = " " if upper[first] == lower[first] else "▀"
                text.append(half * (end - first), styles[upper[first]][lower[first]])
        text.append("\n")
    text.right_crop(1)
    return text


def plain_map(window: U8, robot: Robot | None, factor: int = 1, lines: Lines = NO_LINES) -> str:
    full = image_from_window(window)
    image = downsampled(full, factor).copy()
    lines.draw(image, window.shape, factor)
    signs = np.array(list(SIGNS))[image]
    known = image != UNKNOWN
    if robot is not None:
        row, col = cell_of_robot(robot, full.shape, factor)
        if 0 <= row < image.shape[0] and 0 <= col < image.shape[1]:
            signs[row, col] = LETTERS[round(robot.yaw_rad / (math.pi / 2)) % 4]
            known[row, col] = True
    if not known.any():
        return "(nothing known)"
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    shown = signs[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    return "\n".join("".join(line).rstrip() for line in shown)


def plain_legend(cell_m: float, lines: Lines = NO_LINES) -> str:
    drawn = "o object   m moving object   * path to drive\n" if lines.any else ""
    return (
        f"{drawn}# obstacle   . free   (blank) unknown   ^ < v > robot and heading   "
        f"1 character = {cell_m:.2f} m\nup: map x, where the robot's nose pointed at first; left: y"
    )


# The numbers beside it


def link_words(planner: Receiver, now_s: float) -> tuple[str, str]:
    if planner.blank:
        return "BLANK: no map has arrived", BAD
    if planner.stale(now_s):
        return "STALE: poses or maps do not arrive in time", BAD
    if planner.suspect:
        return "SUSPECT: a lost frame is not repaired yet", POOR
    return "live", GOOD


def status_lines(planner: Receiver, meter: Meter, now_s: float) -> list[Text]:
    maps, poses, bytes_per_s = meter.rates(now_s)
    link, link_style = link_words(planner, now_s)
    advice, why = planner.advice(now_s)
    advice_style = {"go": GOOD, "slow": POOR, "stop": BAD}[advice]
    window = planner.window()
    delay = "delay" if meter.same_clock else "jitter"  # without a common clock
    rejected = planner.rejected.total()
    lines = [
        labelled("link", link, link_style),
        labelled("planner", f"would {advice}" + (f": {why}" if why else ""), advice_style),
        labelled("rates", f"map {maps:.1f}/s  pose {poses:.1f}/s  {bytes_per_s / 1000:.1f} kB/s"),
        labelled(delay, delay_words(meter.link_ms, meter.link)),
        labelled("scan age", delay_words(meter.scan_ms, meter.scan)),
        labelled("frames", f"{planner.accepted.total()} taken, {planner.numbers.missing} missing"),
        labelled(
            "", f"{rejected} rejected, {planner.ignored.repeated} late", POOR if rejected else ""
        ),
        labelled("cells", f"{np.sum(window == FREE)} free, {np.sum(window == OBSTACLE)} obstacle"),
    ]
    told = ("objects", objects_words(planner, now_s)), ("path", path_words(planner, now_s))
    lines += [labelled(*row, POOR if "not sure" in row[1] else "") for row in told if row[1]]
    return lines + (pose_lines(planner.pose) if planner.pose is not None else [])


def delay_words(newest_ms: float, delays: Delays) -> str:
    if math.isnan(newest_ms):
        return "-"
    median_ms, p99_ms = delays.quantile_ms(0.5), delays.quantile_ms(0.99)
    return f"{newest_ms:.1f} ms (median {median_ms:.1f}, p99 {p99_ms:.1f})"


def pose_lines(pose: Pose) -> list[Text]:
    missing = [name for bit, name in enumerate(MISSING) if not pose.health >> bit & 1]
    warnings = [name for bit, name in WARNINGS.items() if pose.health >> bit & 1]
    mode = MODES[pose.mode] if pose.mode < len(MODES) else f"unknown ({pose.mode})"
    mode_style = {1: GOOD, 2: POOR}.get(pose.mode, BAD)
    ages_s = pose.age_scan_s, pose.age_ahrs_s, pose.age_enc_s
    ages = [f"{1000 * age_s:.0f}" if math.isfinite(age_s) else ">1020" for age_s in ages_s]
    lines = [
        labelled("mode", mode, mode_style),
        labelled("health", "all well" if not missing else "no " + ", no ".join(missing),
                 BAD if missing else GOOD),
        labelled("inputs", "scan {} ms  ahrs {} ms  place {} ms".format(*ages)),
        labelled("pose", f"x {pose.x_m:+.2f}  y {pose.y_m:+.2f} m  "
                         f"yaw {math.degrees(pose.yaw_rad):+.1f}°"),
        labelled("", f"pitch {math.degrees(pose.pitch_rad):+.2f}°  "
                     f"roll {math.degrees(pose.roll_rad):+.2f}°"),
        labelled("speed", f"{pose.v_mps:+.2f} m/s  {math.degrees(pose.w_radps):+.1f} °/s"),
    ]  # fmt: skip
    if warnings:
        lines.insert(2, labelled("warning", ", ".join(warnings), BAD))
    return lines


def labelled(label: str, words: str, style: str = "") -> Text:
    line = Text(no_wrap=True, overflow="ellipsis")
    line.append(f"{label:<9}", LABEL)
    return line.append(words, style)


def head_lines(planner: Receiver, factor: int, drawn: Lines = NO_LINES) -> list[Text]:
    if planner.geom is None:
        return [Text("mapod: waiting for the map's geometry", "bold")]
    geom = planner.geom
    drawn_m = geom.cell_m * factor
    bar_m = max([m for m in (0.5, 1, 2, 5, 10, 20) if m / drawn_m <= 24] or [0.5])
    bar = "├" + "─" * max(round(bar_m / drawn_m) - 2, 0) + "┤"
    legend = Text(no_wrap=True)
    for name, state in (("free", FREE), ("obstacle", OBSTACLE), ("robot", ROBOT)):
        legend.append("██", COLOURS[state]).append(f" {name}  ")
    legend.append("██", COLOURS[UNKNOWN]).append(" unknown")
    over = Text(no_wrap=True)
    for name, kind in (("object", OBJECT), ("moving", MOVING), ("path", PATH)):
        over.append("██", COLOURS[kind]).append(f" {name}  ")
    zoom = f" ({factor} x {factor} as one)" if factor > 1 else ""
    return [
        Text(f"{geom.width} x {geom.height} cells of {geom.cell_m:.2f} m{zoom}", "bold"),
        legend,
        *([over] if drawn.any else []),
        Text(f"{bar} {bar_m:g} m   up: map x   left: map y"),
    ]


# The whole


def has_screen(console: Console) -> bool:
    """Whether there is a terminal that can be drawn on, in colour."""
    colours = console.color_system is not None and not console.no_color
    return console.is_terminal and not console.is_dumb_terminal and colours


def picture(
    planner: Receiver, meter: Meter, now_s: float, columns: int, lines: int
) -> RenderableType:
    """Map and panel, for a terminal of this size; beside each other, or below, as fits better."""
    status = status_lines(planner, meter, now_s)
    window, robot, over = planner.window(), maybe_robot(planner), lines_of(planner, now_s)
    shape = (window.shape[1], window.shape[0])
    if not window.size:
        return Group(*head_lines(planner, 1), *status)
    abreast = max(1, columns // (PANEL_COLUMNS + 2))
    head = len(head_lines(planner, 1, over))
    panel_lines = -(-(len(status) + head + 1) // abreast)
    beside = factor_for(shape, columns - PANEL_COLUMNS - 2, lines)
    below = factor_for(shape, columns, lines - panel_lines)
    factor = min(beside, below)
    entries = [*head_lines(planner, factor, over), Text(""), *status]
    drawn = map_text(window, robot, factor, over)
    if beside <= below:
        table = Table.grid(padding=(0, 2))
        table.add_row(drawn, Group(*entries[: max(lines, 1)]))
        return table
    grid = Table.grid(padding=(0, 2))
    for _ in range(abreast):
        grid.add_column(width=PANEL_COLUMNS, no_wrap=True)
    del entries[head]
    entries += [Text("")] * (-len(entries) % abreast)
    per_column = len(entries) // abreast
    for i in range(per_column):
        grid.add_row(*(entries[i + column * per_column] for column in range(abreast)))
    return Group(drawn, grid)
