"""What the programs of single fakes share: so that people can try their drivers on each.

    python -m fakes.programs.lms1xx --port 2112 --fault mute@5s
    python -m fakes.programs.mti --link $HOME/mti --scene turning
    python -m fakes.programs.ax3500 --link $HOME/ax3500 --mode rc --fault emergency_stop@5s-8s
    python -m fakes.programs.stripe --port 8080 --fault ambient=sun@10s
    python -m fakes.programs.visionary --fault stream.cut@5s-6s

One line of JSON on the standard output says where it is; what happens is told on the standard
error. It serves in real time until SIGINT, SIGTERM or its time is up. Source: the devices' sheets.
"""

import argparse
from collections.abc import Callable, Sequence
from contextlib import closing
from typing import Any

from fakes.programs.serving import Stop, add_options, say, serve
from fakes.wires.wire import PtyWire, TcpWire
from fakes.world.simple import Ground, Room

Step = Callable[[float], None]
Built = tuple[Any, Step]  # a fake, and what to step before its wire


def parser_of(name: str, port: int | None, scenes: Sequence[str]) -> argparse.ArgumentParser:
    """The options of every fake; without a port it is on a pty."""
    parser = argparse.ArgumentParser(
        prog=f"python -m fakes.programs.{name}",
        description=f"A fake {name} that other programs can talk to, in real time.",
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on")
    parser.add_argument(
        "--port", type=int, default=port, help=f"TCP port; 0: a free one (default: {port or 'pty'})"
    )
    parser.add_argument(
        *("--link", "--pty"), default="", metavar="PATH", help="pty, with a link to it at PATH"
    )
    parser.add_argument(
        "--scene", default=scenes[0], help=f"{', '.join(scenes)}, or a world's (needs MuJoCo)"
    )
    parser.set_defaults(tell=True)
    add_options(parser, "NAME")
    return parser


def run(
    name: str, parser: argparse.ArgumentParser, build: Callable[[argparse.Namespace], Built]
) -> int:
    stop = Stop()
    given = parser.parse_args()
    try:
        fake, step = build(given)
        with closing(_wire(given, fake)) as wire:
            ports = {name: url_of(name, wire, fake)}
            serve(name, given, stop, ports, [wire], {"": (fake, wire)}, step)
    except (OSError, KeyError, ValueError, ImportError) as error:
        say(name, f"{error}")
        return 2
    return 0


def _wire(given: argparse.Namespace, fake: Any) -> TcpWire | PtyWire:
    if given.link or given.port is None:
        return PtyWire(fake, given.link, seed=given.seed)
    return TcpWire(fake, given.host, given.port, seed=given.seed)


def url_of(name: str, wire: TcpWire | PtyWire, fake: Any) -> str:
    """Where a host finds a device, in the form that settings have."""
    if isinstance(wire, TcpWire):
        return f"tcp://{wire.host}:{wire.port}"
    form = "&parity=E&bytesize=7" if name in ("ax3500", "drive") else ""
    baud = getattr(fake, "baud", None) or 115200  # none: USB takes any
    return f"serial://{wire.path}?baud={baud}{form}"


def world_of(given: argparse.Namespace) -> Any:
    """A world with a robot that stands still."""
    try:
        from fakes.world.world import World
    except ImportError as error:
        raise ImportError(f"--scene {given.scene} needs MuJoCo (extra 'sim'): {error}") from None
    return World(given.scene, given.seed)


def met_of(given: argparse.Namespace) -> tuple[Any, Any]:
    """What a camera's rays meet, by its `met`: simple ground or a world; and that world, if any."""
    if given.scene.partition(":")[0] in ("floor", "wall"):
        return Ground(given.scene).met, None
    world = world_of(given)
    return world.met, world


def ranges_of(given: argparse.Namespace) -> tuple[Any, Any]:
    """What a scanner measures in a simple room or a world; and that world, if any."""
    if given.scene.partition(":")[0] in ("room", "empty", "wall"):
        return Room(given.scene).ranges_m_at, None
    world = world_of(given)
    return lambda t_first_s, times_s, bearings: world.ranges_m(times_s, bearings), world


def stepped(world: Any, first: Step) -> Step:
    """Steps a world, if there is one; with the first step something else is done, too."""
    begun: list[float] = []

    def step(now_s: float) -> None:
        if world is not None:
            world.step_to(now_s)
        if not begun:
            begun.append(now_s)
            first(now_s)

    return step
