"""World and devices as one process in real time: scanner on TCP, attitude sensor and drive on ptys.

Prints one line of JSON that says where, then serves until SIGINT, SIGTERM or its time is up. Faults
carry the device's name: `--fault scanner.mute@5s-7s --fault drive.gone@10s+2s`. A device that is
left out has no port (null), so that a real one can be used in its place.
"""

import argparse
import sys
from collections.abc import Callable
from contextlib import ExitStack, closing
from typing import Any

from fakes.serving import Stop, add_options, say, serve

DEVICES = ("scanner", "ahrs", "drive")


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m fakes",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--scene", default="corridor", help="shipped scene, or a scene's file")
    parser.add_argument(
        *("--scanner-port", "--lms"),
        dest="scanner_port",
        type=int,
        default=0,
        help="TCP port of the scanner; 0: a free one",
    )
    parser.add_argument("--ahrs-link", default="", help="symbolic link to make to its terminal")
    parser.add_argument("--drive-link", default="", help="symbolic link to make to its terminal")
    parser.add_argument("--drive-mode", default="rs232", help="of the controller, as it starts")
    parser.add_argument("--start-delay", type=float, default=3.0, help="seconds before it drives")
    parser.add_argument("--no-driver", action="store_true", help="wheels obey the wire only")
    parser.add_argument(
        "--leave-out", action="append", default=[], choices=DEVICES, help="repeatable"
    )
    parser.add_argument("--tell", action="store_true", help="say who connects and who leaves")
    add_options(parser, "DEVICE.NAME")
    return parser.parse_args()


def serve_rig(given: argparse.Namespace, stop: Stop) -> None:
    """Build all, say where it is, and keep it in step with the host's clock."""
    from fakes.ax3500 import MODES
    from fakes.rig import Rig  # these take half a second: after the handlers of main()
    from fakes.wire import PtyWire, TcpWire

    if given.drive_mode not in MODES:
        raise ValueError(f"--drive-mode: must be one of {', '.join(MODES)}: {given.drive_mode}")
    rig = Rig(given.scene, given.seed, given.start_delay, drives=not given.no_driver)
    rig.drive.mode = given.drive_mode
    rig.drive.parameters[0x00] = MODES.index(given.drive_mode)
    wires: dict[str, tuple[Callable[[], Any], str]] = {
        "scanner": (
            lambda: TcpWire(rig.scanner, "127.0.0.1", given.scanner_port, seed=given.seed),
            "tcp://127.0.0.1:{0.port}",
        ),
        "ahrs": (
            lambda: PtyWire(rig.ahrs, given.ahrs_link, seed=given.seed + 1),
            "serial://{0.path}?baud=115200",
        ),
        "drive": (
            lambda: PtyWire(rig.drive, given.drive_link, seed=given.seed + 2),
            "serial://{0.path}?baud=9600&parity=E&bytesize=7",
        ),
    }
    with ExitStack() as open_wires:
        there = {
            name: open_wires.enter_context(closing(make()))
            for name, (make, _) in wires.items()
            if name not in given.leave_out
        }
        ports = {
            name: url.format(there[name]) if name in there else None
            for name, (_, url) in wires.items()
        }
        targets = {name: (getattr(rig, name), wire) for name, wire in there.items()}
        serve("fakes", given, stop, ports, list(there.values()), targets, rig.step)


def main() -> int:
    """Serve until a signal says stop; exit status."""
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
