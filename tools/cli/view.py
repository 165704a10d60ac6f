"""The map that a planner gets, as it grows, and what the link tells of robot and health.

A live page for browsers, at the address that the first line tells; or --terminal, a picture in this
terminal. It answers the sender as a planner would, and asks it to move the robot while keys are
held: mapod obeys where its settings enable the motors. Beside a planner, give it a receiver of its
own: [planner] port may be a list. Ctrl-C ends it.
"""

import argparse
import contextlib
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from config_file import read_key
from core.config import ConfigError
from mapod_link.bodies import ZONE_STALE_S, StopZone
from mapod_link.wires import wire_from_url
from tools.cli.options import fail, number_in, parser_of
from tools.terminal.outlines import lines_of
from tools.terminal.planner_end import PlannerEnd, WatchingReceiver
from tools.terminal.processes import Stop
from tools.terminal.screen import (
    BAD,
    GOOD,
    POOR,
    has_screen,
    labelled,
    link_words,
    map_text,
    maybe_robot,
    picture,
    plain_legend,
    plain_map,
    status_lines,
)
from tools.terminal.steer import Steering, keys_of

PICTURE_PERIOD_S, PROGRESS_PERIOD_S = 0.1, 3.0
WAIT_S = 0.02
PAGE_AT = "127.0.0.1", 8750
PORT = "udp://127.0.0.1:9750"
NO_FOXGLOVE = "--foxglove needs the extra foxglove: pip install '/path/to/mapod[foxglove]'"
NO_PAGE = "the page needs the extra view: pip install '/path/to/mapod[view]'; --terminal does not"
ZONE_STYLES = {1: GOOD, 2: POOR}  # by state; all others are bad
KINDS = {1: "GEOM", 2: "POSE", 3: "MAP", 4: "DIGEST", 5: "STOP_ZONE"}


def watch(
    end: PlannerEnd,
    console: Console,
    done: Callable[[float], bool],
    remark: Callable[[float], str] | None = None,
) -> None:
    """Shows the map as it grows until `done(now_s)`; without a screen, a line now and then.

    `remark(now_s)` is shown above it, and what the sender says of the robot's way.
    """
    if has_screen(console):
        with Live(console=console, screen=True, auto_refresh=False) as live:
            drawn_s = 0.0
            while not done(now_s := end.step(WAIT_S)):
                if now_s - drawn_s >= PICTURE_PERIOD_S:
                    drawn_s, (columns, lines) = now_s, console.size
                    said = remark(now_s).splitlines() if remark else []
                    above = [Text(line, "bold") for line in said]
                    above += zone_lines(end.planner.stop_zone, now_s)
                    drawn = picture(end.planner, end.meter, now_s, columns, lines - len(above))
                    live.update(Group(*above, drawn), refresh=True)
        return
    told_s = 0.0
    while not done(now_s := end.step(WAIT_S)):
        if now_s - told_s >= PROGRESS_PERIOD_S:
            told_s = now_s
            line = progress_line(end, now_s) + (f"\n{remark(now_s)}" if remark else "")
            console.print(line.replace("\n", "; "), highlight=False, soft_wrap=True)


def zone_lines(zone: StopZone | None, now_s: float) -> list[Text]:
    if zone is None:
        return []
    words, style = zone.describe(), ZONE_STYLES.get(zone.state, BAD)
    (ahead_m, behind_m), old_s = (zone.free_ahead_m, zone.free_behind_m), now_s - zone.arrived_s
    if old_s > ZONE_STALE_S:
        words, style, ahead_m, behind_m = f"not heard for {old_s:.1f} s", BAD, 0.0, 0.0
    ahead_mps, behind_mps = zone.allowed_mps(now_s)
    line = labelled("way", words, style)
    line.append(f"  ahead {ahead_m:.2f} m, {ahead_mps:.2f} m/s")
    line.append(f"  behind {behind_m:.2f} m, {behind_mps:.2f} m/s")
    return [line]


def progress_line(end: PlannerEnd, now_s: float) -> str:
    planner, pose = end.planner, end.planner.pose
    if planner.blank:
        return f"  {link_words(planner, now_s)[0]}"
    maps, _, bytes_per_s = end.meter.rates(now_s)
    window = planner.window()
    where = f"x {pose.x_m:+.1f} y {pose.y_m:+.1f} m, " if pose is not None else ""
    way = "".join(
        f"; {' '.join(line.plain.split())}" for line in zone_lines(planner.stop_zone, now_s)
    )
    return (
        f"  {link_words(planner, now_s)[0]}: {where}{(window == 1).sum()} free and "
        f"{(window == 2).sum()} obstacle cells, {maps:.0f} maps/s, {bytes_per_s / 1000:.1f} kB/s, "
        f"scan age {end.meter.scan.quantile_ms(0.5):.1f} ms{way}"
    )


def print_summary(end: PlannerEnd, console: Console, now_s: float) -> None:
    planner, gaps = end.planner, end.planner.numbers.gaps
    if planner.geom is None or planner.blank:
        console.print("no map has arrived")
        return
    window, robot, lines = planner.window(), maybe_robot(planner), lines_of(planner, now_s)
    if has_screen(console):
        factor = max(1, -(-window.shape[0] // console.width))
        console.print(map_text(window, robot, factor, lines))
    else:
        drawn, legend = plain_map(window, robot, 1, lines), plain_legend(planner.geom.cell_m, lines)
        print(drawn, legend, sep="\n", flush=True)
    span_s = now_s - end.meter.first_s
    kinds = ", ".join(f"{planner.accepted[number]} {name}" for number, name in KINDS.items())
    told = [
        *status_lines(planner, end.meter, now_s),
        labelled("run", f"{span_s:.1f} s, {kinds}, {end.meter.bytes / 1000:.0f} kB"),
        labelled("", f"{gaps} gaps, {planner.ignored.maps} maps of another geometry"),
    ]
    for line in told:
        console.print(line if has_screen(console) else Text(line.plain), soft_wrap=True)


def main(arguments: list[str] | None = None, command: str = "view") -> int:
    """Exit status: 0 ended as it was told to, 1 the wire is gone, 2 wrong use.

    Args:
        command: by which it was called, for what is told of wrong use.
    """
    options = options_of(arguments, command)
    if options.foxglove:
        if importlib.util.find_spec("foxglove") is None:
            return fail("view", NO_FOXGLOVE)
        from tools.foxglove_bridge import serve_foxglove

        return serve_foxglove(options)
    if options.terminal or options.drive:
        return in_terminal(options)
    if importlib.util.find_spec("aiohttp") is None:
        return fail("view", NO_PAGE)
    from tools.view.command import serve_page

    return serve_page(options)


def options_of(arguments: list[str] | None, command: str) -> argparse.Namespace:
    parser = parser_of(
        command,
        __doc__,
        "mapod view",
        "mapod view udp://0.0.0.0:9751 --http 0.0.0.0:8750 --token-file view.token",
        "mapod view --terminal --port 'serial:///dev/planner?baud=115200' --drive",
    )
    parser.add_argument("url", nargs="?", help="the same as --port")
    parser.add_port("udp://0.0.0.0:9750", PORT)
    parser.set_defaults(command=command, port=None)
    parser.add_seconds("until Ctrl-C")
    parser.add_key()
    add, terminal = parser.add_argument, "in the terminal"
    about = "where the page is served (default: 127.0.0.1:8750); elsewhere looking needs the token"
    add("--http", type=an_address, default=PAGE_AT, metavar="HOST:PORT", help=about)
    about = "the token for driving, made if it is not there (default: a new one each time)"
    add("--token-file", type=Path, metavar="FILE", help=about)
    about = "the robot's size, limits, motors (default: mapod.toml, where there is one)"
    add("--config", type=Path, help=about)
    add("--terminal", action="store_true", help="a picture in this terminal, no page")
    add("--drive", action="store_true", help=f"{terminal}: drive the robot with the keyboard")
    add("--speed", type=number_in(0.01, 20), help=f"at most so many m/s ({terminal}: 0.3)")
    add("--turn", type=number_in(0.01, 20), help=f"at most so many rad/s ({terminal}: 0.5)")
    add("--foxglove", action="store_true", help="no page: serve Foxglove or Lichtblick")
    add("--foxglove-port", type=a_port, default=8765, help="on this machine (8765)")
    options = parser.parse_args(arguments)
    if options.url is not None and options.port is not None:
        parser.error("URL and --port are the same: give one of them")
    options.port = options.url or options.port or PORT
    return options


def a_port(text: str) -> int:
    if not text.isdecimal() or int(text) > 65_535:
        raise argparse.ArgumentTypeError(f"must be from 0 to 65535, is {text}")
    return int(text)


def an_address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isdecimal() or int(port) > 65_535:
        raise argparse.ArgumentTypeError(f"must be HOST:PORT, is {text}")
    return host, int(port)


def in_terminal(options: argparse.Namespace) -> int:
    try:
        key = read_key(options.key_file)
        wire = wire_from_url(options.port)
    except (ConfigError, ValueError) as error:
        return fail(options.command, error)
    except OSError as error:
        return fail(options.command, f"{options.port}: {error.strerror or error}", 1)
    with contextlib.closing(wire), Stop().on_signals() as stop:
        try:
            return show(options, PlannerEnd(wire, WatchingReceiver(key)), stop)
        except (OSError, ValueError) as error:
            words = getattr(error, "strerror", None) or error
            return fail(options.command, f"{options.port}: {words}", 1)


def show(options: argparse.Namespace, end: PlannerEnd, stop: Stop) -> int:
    """The picture to its end. Raises OSError (the wire is gone), ValueError (no keyboard)."""
    console, began_s = Console(), end.step(0.0)
    until_s = began_s + options.seconds if options.seconds else float("inf")
    print(f"watching {options.port}; Ctrl-C ends", flush=True)
    speeds = (options.speed or 0.3, options.turn or 0.5) if options.drive else None
    watch_and_drive(end, console, lambda now_s: stop.wanted or now_s >= until_s, speeds)
    print_summary(end, console, end.step(0.0))
    return 0


def watch_and_drive(
    end: PlannerEnd,
    console: Console,
    done: Callable[[float], bool],
    speeds: tuple[float, float] | None,
    above: str = "",
) -> None:
    """As `watch`; with speeds (m/s, rad/s), held keys drive: ValueError without a keyboard.

    Args:
        above: a line that stands above the picture.
    """
    if speeds is None:
        watch(end, console, done, (lambda _: above) if above and has_screen(console) else None)
        return
    with keys_of(sys.stdin.fileno()) as fd:
        steering = Steering(end.planner, fd, *speeds)

        def steered(now_s: float) -> bool:
            steering.step(now_s)
            return done(now_s)

        def said(now_s: float) -> str:
            return f"{above}\n{steering.words(now_s)}".strip()

        watch(end, console, steered, said)
        steering.stop(end.step(0.0))
