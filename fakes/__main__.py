"""World and devices as one process in real time: scanner on TCP, attitude sensor and drive on ptys.

Prints one line of JSON that says where, then serves until SIGINT, SIGTERM or its time is up.
"""

import argparse
import gc
import json
import os
import select
import signal
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, closing

PERIOD_S = 0.002
MOST_S = 0.5  # what is made up for after a hold-up; the world keeps the poses of 1 s
STDIN_EVERY_S = 0.1


class Pace:
    """The host's clock as the rig sees it: after a long hold-up it stays behind for good."""

    def __init__(self, host_s: float) -> None:
        self.now_s, self.behind_s = host_s, 0.0

    def step(self, host_s: float) -> bool:
        """Move on; False if the rig has fallen behind once more."""
        late_s = host_s - self.behind_s - self.now_s - MOST_S
        self.behind_s += max(0.0, late_s)
        self.now_s = host_s - self.behind_s
        return late_s <= 0


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m fakes", description=__doc__)
    parser.add_argument("--scene", default="corridor", help="shipped scene, or a scene's file")
    parser.add_argument("--seed", type=int, default=1, help="of all that is random")
    parser.add_argument("--lms", type=int, default=0, help="TCP port of the scanner; 0: a free one")
    parser.add_argument("--seconds", type=float, help="serve for so long (default: until told)")
    parser.add_argument("--start-delay", type=float, default=3.0, help="seconds before it drives")
    parser.add_argument(
        "--until-stdin-closes", action="store_true", help="end when whoever started this is gone"
    )
    return parser.parse_args()


def stdin_closed() -> bool:
    """True once the other end of the standard input is gone; what arrives there is dropped."""
    readable, _, _ = select.select([sys.stdin], [], [], 0.0)
    return bool(readable) and not os.read(sys.stdin.fileno(), 4096)


def serve(given: argparse.Namespace, stopped: Callable[[], bool]) -> None:
    """Build all, say where it is, and keep it in step with the host's clock."""
    from fakes.rig import Rig  # these take half a second: after the handlers of main()
    from fakes.wire import PtyWire, TcpWire

    rig = Rig(given.scene, given.seed, given.start_delay)
    with ExitStack() as open_wires:
        scanner = open_wires.enter_context(closing(TcpWire(rig.scanner, "127.0.0.1", given.lms)))
        ahrs = open_wires.enter_context(closing(PtyWire(rig.ahrs)))
        drive = open_wires.enter_context(closing(PtyWire(rig.drive)))
        ports = {
            "scanner": f"tcp://127.0.0.1:{scanner.port}",
            "ahrs": f"serial://{ahrs.path}?baud=115200",
            "drive": f"serial://{drive.path}?baud=9600&parity=E&bytesize=7",
        }
        print(json.dumps(ports), flush=True)
        gc.collect()
        gc.freeze()
        begin_s = due_s = stdin_due_s = time.monotonic()
        end_s = begin_s + given.seconds if given.seconds is not None else float("inf")
        pace, kept_up = Pace(begin_s), True
        while not stopped() and (host_s := time.monotonic()) < end_s:
            if not pace.step(host_s) and kept_up:
                kept_up = False
                print("fakes: this machine is too slow, the world lags", file=sys.stderr)
            rig.step(pace.now_s)
            for wire in (scanner, ahrs, drive):
                wire.step(pace.now_s)
            if given.until_stdin_closes and host_s >= stdin_due_s:
                stdin_due_s = host_s + STDIN_EVERY_S
                if stdin_closed():
                    break
            due_s = max(due_s + PERIOD_S, time.monotonic() - PERIOD_S)
            time.sleep(max(0.0, due_s - time.monotonic()))


def main() -> int:
    """Serve until a signal says stop; exit status."""
    told: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda signum, frame: told.append(signum))
    given = arguments()
    try:
        serve(given, lambda: bool(told))
    except (OSError, KeyError, ValueError) as error:
        print(f"fakes: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
