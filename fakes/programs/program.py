"""Each fake as a program of its own, so that people can try their drivers on it.

    python -m fakes.programs.lms1xx --port 2112 --fault mute@5s
    python -m fakes.programs.mti --link $HOME/mti --scene turning
    python -m fakes.programs.ax3500 --link $HOME/ax3500 --mode rc --fault emergency_stop@5s-8s

One line of JSON on the standard output says where it is; what happens is told on the standard
error. It serves in real time until SIGINT, SIGTERM or its time is up. Source: the three sheets.
"""

import argparse
import inspect
import struct
from collections.abc import Callable, Sequence
from contextlib import closing
from typing import Any

from fakes.programs.serving import Stop, add_options, say, serve
from fakes.wires.wire import PtyWire, TcpWire
from fakes.world.simple import COUNTS_PER_S, MOTIONS, ROOMS, Motion, Room, TwoWheels

Step = Callable[[float], None]
Built = tuple[Any, Step]  # a fake, and what to step before its wire


def run_scanner(argv: Sequence[str] | None = None) -> int:
    """`python -m fakes.programs.lms1xx`: on TCP; exit status."""
    parser = _parser("lms111", 2112, ROOMS)
    parser.add_argument("--model", help="LMS111 (default) or a sister")
    parser.add_argument("--dialect", choices=("binary", "ascii"), default="binary")
    parser.add_argument("--scan-rate", type=int, choices=(25, 50), help="Hz, as stored in it")
    parser.add_argument("--angular-step", type=float, choices=(0.25, 0.5), help="degrees")

    def build(given: argparse.Namespace) -> Built:
        from fakes.lms1xx.device import FakeLms111

        world = (
            None if given.scene.partition(":")[0] in ("room", "empty", "wall") else _world(given)
        )
        if world is None:
            ranges_m_at = Room(given.scene).ranges_m_at
        else:

            def ranges_m_at(t_first_s: float, times_s: Any, bearings_rad: Any) -> Any:
                return world.ranges_m(times_s, bearings_rad)

        fake = _made(FakeLms111, given, ranges_m_at)
        if given.dialect == "ascii":
            _set(fake, "binary", False, "--dialect ascii")
        asked = given.scan_rate is not None or given.angular_step is not None
        commands = _scan_commands(given) if asked else b""
        return fake, _first_told(fake, commands, world)

    return _run("lms111", parser, build, argv)


def run_attitude(argv: Sequence[str] | None = None) -> int:
    """`python -m fakes.programs.mti`: on a pty, or on TCP; exit status."""
    parser = _parser("mti", None, MOTIONS)
    parser.add_argument("--model", help="MTi-28 (default) or a sister")
    parser.add_argument("--baud", type=int, help="of its line (default: 115200)")
    parser.add_argument("--rate", type=int, help="Hz, as stored in it; legacy models")

    def build(given: argparse.Namespace) -> Built:
        from fakes.mti.device import FakeMti

        world = None if given.scene in MOTIONS else _world(given)
        motion_at = Motion(given.scene).motion_at if world is None else world.motion_at
        fake = _made(FakeMti, given, motion_at)
        if given.baud is not None:
            fake.baud = given.baud
        commands = _rate_commands(given.rate) if given.rate is not None else b""
        return fake, _first_told(fake, commands, world)

    return _run("mti", parser, build, argv)


def run_drive(argv: Sequence[str] | None = None) -> int:
    """`python -m fakes.programs.ax3500`: on a pty, or on TCP; exit status."""
    from fakes.ax3500.device import FakeAx3500
    from fakes.ax3500.properties import MODES, PROFILES

    parser = _parser("ax3500", None, ("free",))
    parser.add_argument("--model", choices=tuple(PROFILES), default="AX3500")
    parser.add_argument("--mode", choices=MODES, default="rs232", help="as stored in it")
    parser.add_argument("--counts-per-s", type=float, default=COUNTS_PER_S, help="at full power")
    parser.add_argument("--unpaced", action="store_true", help="characters take no time")

    def build(given: argparse.Namespace) -> Built:
        world = None if given.scene == "free" else _world(given)
        wheels = TwoWheels(given.counts_per_s) if world is None else world.wheels
        fake = FakeAx3500(
            wheels, given.seed, given.mode, model=given.model, paced=not given.unpaced
        )
        fake.load_a = 12.0
        step: Step = wheels.step_to if isinstance(wheels, TwoWheels) else _stepper(world)
        return fake, step

    return _run("ax3500", parser, build, argv)


def _parser(name: str, port: int | None, scenes: Sequence[str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=f"python -m fakes.{name}",
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


def _run(
    name: str,
    parser: argparse.ArgumentParser,
    build: Callable[[argparse.Namespace], Built],
    argv: Sequence[str] | None,
) -> int:
    stop = Stop()
    given = parser.parse_args(argv)
    try:
        fake, step = build(given)
        with closing(_wire(given, fake)) as wire:
            serve(
                name, given, stop, {name: _url(name, wire, fake)}, [wire], {"": (fake, wire)}, step
            )
    except (OSError, KeyError, ValueError, ImportError) as error:
        say(name, f"{error}")
        return 2
    return 0


def _wire(given: argparse.Namespace, fake: Any) -> TcpWire | PtyWire:
    if given.link or given.port is None:
        return PtyWire(fake, given.link, seed=given.seed)
    return TcpWire(fake, given.host, given.port, seed=given.seed)


def _url(name: str, wire: TcpWire | PtyWire, fake: Any) -> str:
    if isinstance(wire, TcpWire):
        return f"tcp://{wire.host}:{wire.port}"
    form = "&parity=E&bytesize=7" if name == "ax3500" else ""
    return f"serial://{wire.path}?baud={getattr(fake, 'baud', 115200)}{form}"


def _world(given: argparse.Namespace) -> Any:
    """A world with a robot that stands still."""
    try:
        from fakes.world.world import World
    except ImportError as error:
        raise ImportError(f"--scene {given.scene} needs MuJoCo (extra 'sim'): {error}") from None
    return World(given.scene, given.seed)


def _stepper(world: Any) -> Step:
    step: Step = world.step_to if world is not None else lambda now_s: None
    return step


def _first_told(fake: Any, commands: bytes, world: Any) -> Step:
    """Steps the world; at first the fake is told something, as a person before would have."""
    told: list[float] = []
    step_world = _stepper(world)

    def step(now_s: float) -> None:
        step_world(now_s)
        if commands and not told:
            told.append(now_s)
            fake.exchange(now_s, commands)

    return step


def _made(sort: Callable[..., Any], given: argparse.Namespace, truth: Any) -> Any:
    """A fake of a model; says so if it knows no models."""
    if given.model is None:
        return sort(truth, given.seed)
    if "model" not in inspect.signature(sort).parameters:
        raise ValueError(f"--model {given.model}: there is one model only")
    return sort(truth, given.seed, model=given.model)


def _set(fake: Any, name: str, value: object, option: str) -> None:
    if not hasattr(fake, name):
        raise ValueError(f"{option}: this fake cannot do it")
    setattr(fake, name, value)


def _scan_commands(given: argparse.Namespace) -> bytes:
    """Login, rate and step, keep, run: as the scanner takes them in its dialect."""
    hundredths_hz = 100 * (given.scan_rate or (25 if given.angular_step == 0.25 else 50))
    step_raw = round(10000 * (given.angular_step or 0.5))
    if given.dialect == "ascii":
        texts = (
            "sMN SetAccessMode 03 F4724744",
            f"sMN mLMPsetscancfg +{hundredths_hz} +1 +{step_raw} -450000 +2250000",
            "sMN mEEwriteall",
            "sMN Run",
        )
        return b"".join(b"\x02" + text.encode("ascii") + b"\x03" for text in texts)
    payloads = (
        b"sMN SetAccessMode " + bytes.fromhex("03 F4724744"),
        b"sMN mLMPsetscancfg "
        + struct.pack(">IHIii", hundredths_hz, 1, step_raw, -450000, 2250000),
        b"sMN mEEwriteall",
        b"sMN Run",
    )
    return b"".join(_cola_b(payload) for payload in payloads)


def _cola_b(payload: bytes) -> bytes:
    checksum = 0
    for byte in payload:
        checksum ^= byte
    return b"\x02" * 4 + struct.pack(">I", len(payload)) + payload + bytes([checksum])


def _rate_commands(rate_hz: int) -> bytes:
    """GoToConfig, SetPeriod, GoToMeasurement."""
    period = struct.pack(">H", round(115200 / rate_hz))
    return b"".join(_xbus(mid, data) for mid, data in ((0x30, b""), (0x04, period), (0x10, b"")))


def _xbus(mid: int, data: bytes) -> bytes:
    body = bytes([0xFF, mid, len(data)]) + data
    return b"\xfa" + body + bytes([-sum(body) & 0xFF])
