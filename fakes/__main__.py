"""World and devices as one process in real time: scanner on TCP, attitude sensor and drive on ptys.

Prints one line of JSON that says where, then serves until SIGINT, SIGTERM or its time is up. Faults
carry the device's name: `--fault scanner.mute@5s-7s --fault drive.gone@10s+2s`. A device that is
left out has no port (null), so that a real one can be used in its place. For meters and judges it
writes into files when each scan left (`--stamp`) and what is true of the robot (`--truth`).
"""

import argparse
import math
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fakes.programs.serving import Stop, add_options, say, serve

if TYPE_CHECKING:
    from fakes.programs.positioning import PositioningOnUdp
    from fakes.scenes.scene import Scene
    from fakes.visionary.device import FakeVisionary
    from fakes.world.rig import Rig

DEVICES = ("scanner", "ahrs", "drive")
BY_FOUR = b"\x02"  # its binning: 4 x 4 pixels are one


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m fakes",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--scene", default="corridor", help="shipped scene, or a scene's file")
    _add_robot(parser)
    parser.add_argument("--start-delay", type=float, default=3.0, help="seconds before it drives")
    parser.add_argument("--no-driver", action="store_true", help="wheels obey the wire only")
    parser.add_argument(
        "--leave-out", action="append", default=[], choices=DEVICES, help="repeatable"
    )
    parser.add_argument(
        "--sheet-errors", action="store_true", help="sensors err as their sheets say"
    )
    parser.add_argument(
        "--positioning",
        action="store_true",
        help="a system that sees the robot, on UDP as a planner",
    )
    parser.add_argument("--stamp", type=Path, metavar="FILE", help="when each scan left, into FILE")
    parser.add_argument(
        "--truth", type=Path, metavar="FILE", help="the robot's true way, into FILE"
    )
    parser.add_argument("--tell", action="store_true", help="say who connects and who leaves")
    add_options(parser, "DEVICE.NAME")
    return parser.parse_args()


def _add_robot(parser: argparse.ArgumentParser) -> None:
    """Which devices it has, where they sit, and the ports that they are on."""
    parser.add_argument(
        *("--scanner-port", "--lms"),
        dest="scanner_port",
        type=int,
        default=0,
        help="TCP port of the scanner; 0: a free one",
    )
    parser.add_argument("--scanner", default="lms111", help="which one: lms111, urg04lx, stripe")
    parser.add_argument(
        "--lens",
        nargs=4,
        type=float,
        metavar=("X_M", "Y_M", "Z_M", "TILT_DEG"),
        help="where the scanner sits on the body, and how much it looks down",
    )
    parser.add_argument(
        "--wheels",
        nargs=2,
        type=float,
        metavar=("RADIUS_M", "TRACK_M"),
        help="of the drive wheels, by which the robot is known; other than ragno's: the usual one",
    )
    parser.add_argument(
        "--most-speed", type=float, default=math.inf, help="m/s: the driver drives no faster"
    )
    parser.add_argument(
        "--camera",
        nargs=4,
        type=float,
        metavar=("X_M", "Y_M", "Z_M", "TILT_DEG"),
        help="a Visionary-T Mini of 128 x 106 pixels sits there and looks down: two more ports",
    )
    parser.add_argument("--ahrs-link", default="", help="symbolic link to make to its terminal")
    parser.add_argument("--drive-link", default="", help="symbolic link to make to its terminal")
    parser.add_argument(
        "--all-tcp", action="store_true", help="no terminals: these two on free TCP ports as well"
    )
    parser.add_argument("--drive-mode", default="rs232", help="of the controller, as it starts")


def rig_of(given: argparse.Namespace, scene: "Scene") -> "Rig":
    """World and devices as the options say; ValueError: they can't be so."""
    from fakes.ax3500.properties import MODES
    from fakes.programs.stamps import WatchedWorld
    from fakes.world.error_models import as_the_sheets_say
    from fakes.world.rig import SCANNERS, AnyWorld, Rig, world_of
    from fakes.world.robot import BODY, body_with, mount_from

    if given.drive_mode not in MODES:
        raise ValueError(f"--drive-mode: must be one of {', '.join(MODES)}: {given.drive_mode}")
    if given.scanner not in SCANNERS:
        raise ValueError(f"--scanner: must be one of {', '.join(SCANNERS)}: {given.scanner}")
    if scene.walks and (given.no_driver or given.stamp):
        option = "--no-driver" if given.no_driver else "--stamp"
        raise ValueError(f"{option}: not in {scene.name!r}, where the robot walks by itself")
    seed, delay_s, drives = given.seed, given.start_delay, not given.no_driver
    errors = as_the_sheets_say(scene.errors) if given.sheet_errors else None
    lens = mount_from("--lens", *given.lens) if given.lens else None
    mount = lens or SCANNERS[given.scanner].mount
    body = body_with(*given.wheels) if given.wheels else BODY
    world: AnyWorld
    if given.stamp:
        world = WatchedWorld(scene, seed, errors, mount, body)
    else:
        world = world_of(scene, seed, delay_s, errors, mount, body)
    if not given.most_speed > 0.0:
        raise ValueError(f"--most-speed: must be above 0: {given.most_speed:g}")
    rig = Rig(
        *(world, seed, delay_s, drives),
        scanner=given.scanner, mount=lens, body=body, most_mps=given.most_speed,
    )  # fmt: skip
    rig.drive.mode = given.drive_mode
    rig.drive.parameters[0x00] = MODES.index(given.drive_mode)
    return rig


def serve_rig(given: argparse.Namespace, stop: Stop) -> None:
    from fakes.programs.positioning import PositioningOnUdp
    from fakes.programs.stamps import StampedScanner, WatchedWorld
    from fakes.scenes.scene import load_scene

    # this takes half a second: after the handlers of main()
    from fakes.world.truth_log import GroundTruthLog

    with ExitStack() as files:
        rig = rig_of(given, load_scene(given.scene, given.seed))
        world = rig.world
        fakes: dict[str, Any] = {name: getattr(rig, name) for name in DEVICES}
        seen = dict(fakes)  # by the wires
        if isinstance(world, WatchedWorld):
            stamps: list[str] = []
            out = files.enter_context(given.stamp.open("w", encoding="ascii"))
            files.callback(out.writelines, stamps)
            seen["scanner"] = StampedScanner(rig.scanner, world.swept_s, stamps, time.monotonic)
        steps: list[Callable[[float], None]] = [rig.step]
        if given.truth:
            out = files.enter_context(given.truth.open("w", encoding="ascii"))
            steps.append(GroundTruthLog(out, world, given.scene, given.seed).step)

        watchers: dict[str, PositioningOnUdp] = {}
        if given.positioning:
            watchers["positioning"] = PositioningOnUdp(world, given.seed)
            files.enter_context(closing(watchers["positioning"]))
            steps.append(watchers["positioning"].step)

        def step(now_s: float) -> None:
            for one in steps:
                one(now_s)

        camera = camera_of(given, rig) if given.camera else None
        serve_on_wires(given, stop, fakes, seen, watchers, step, camera)


def camera_of(given: argparse.Namespace, rig: "Rig") -> "FakeVisionary":
    """The depth camera of the options, in that world; ValueError: it can't be so."""
    from fakes.visionary.device import FakeVisionary
    from fakes.world.robot import mount_from

    mount = mount_from("--camera", *given.camera)
    camera = FakeVisionary("t_mini", rig.world.met, given.seed + len(DEVICES))
    camera.mount_m, camera.tilt_deg = mount[:3], mount.tilt_deg
    camera.memory.written["binningOption"] = BY_FOUR
    camera.warm()
    return camera


def serve_on_wires(
    given: argparse.Namespace,
    stop: Stop,
    fakes: dict[str, Any],
    seen: dict[str, Any],
    watchers: "dict[str, PositioningOnUdp]",
    step: Callable[[float], None],
    camera: "FakeVisionary | None",
) -> None:
    """A wire for each fake that is not left out, and two for a camera.

    `seen` is what stands behind a wire.
    """
    from fakes.programs.program import url_of
    from fakes.wires.wire import PtyWire, TcpWire

    wires: dict[str, TcpWire | PtyWire] = {}
    with ExitStack() as open_wires:
        for k, name in enumerate(DEVICES):
            if name in given.leave_out:
                continue
            fake, seed = seen[name], given.seed + k
            if name == "scanner":
                wires[name] = TcpWire(fake, port=given.scanner_port, seed=seed)
            elif given.all_tcp:
                wires[name] = TcpWire(fake, seed=seed)
            else:
                wires[name] = PtyWire(fake, getattr(given, f"{name}_link"), seed=seed)
            open_wires.enter_context(closing(wires[name]))
        ports: dict[str, str | None] = {
            name: url_of(name, wires[name], fakes[name]) if name in wires else None
            for name in DEVICES
        }
        ports |= {name: watcher.url for name, watcher in watchers.items()}
        if camera is not None:
            wires["depth"] = control = TcpWire(camera.control, seed=given.seed)
            open_wires.enter_context(closing(control))
            wires["stream"] = stream = TcpWire(camera.stream, seed=given.seed)
            open_wires.enter_context(closing(stream))
            camera.memory.written["BlobTcpPortAPI"] = stream.port.to_bytes(2, "big")
            ports["depth"] = f"tcp://{control.host}:{control.port}"
            fakes["depth"] = fakes["stream"] = camera
        targets: dict[str, tuple[Any, ...]] = {
            name: (fakes[name], wire) for name, wire in wires.items()
        }
        targets |= {name: (watcher.system,) for name, watcher in watchers.items()}
        serve("fakes", given, stop, ports, list(wires.values()), targets, step)


def main() -> int:
    stop = Stop()
    given = arguments()
    try:
        serve_rig(given, stop)
    except (OSError, KeyError, ValueError) as error:
        say("fakes", f"{error}")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
