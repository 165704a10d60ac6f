"""Keeps fakes in step with the host's clock for as long as a program serves them.

The only part of the fakes that reads a clock, waits, and says things on the standard error.
"""

import argparse
import gc
import json
import os
import select
import signal
import sys
import time
from collections.abc import Callable, Mapping, Sequence

from fakes.faults.handles import FaultError, seconds_from_text
from fakes.faults.timetable import Schedule, list_of_all, order_from_text
from fakes.wires.wire import PtyWire, TcpWire

PERIOD_S = 0.002  # bytes are handed over so often; a USB adapter set to low latency: 0.001
SHORTEST_S, LONGEST_S = 0.0005, 0.1
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


class Stop:
    """Told by SIGINT or SIGTERM to end; catches them from its making on."""

    def __init__(self) -> None:
        self.told = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._tell)

    def _tell(self, number: int, frame: object) -> None:
        self.told = True


def add_options(parser: argparse.ArgumentParser, name: str) -> None:
    """The options that all programs of the fakes have; `name` is how a fault's name looks."""
    parser.add_argument("--seed", type=int, default=1, help="of all that is random")
    parser.add_argument("--seconds", type=float, help="serve for so long (default: until told)")
    parser.add_argument(
        "--until-stdin-closes", action="store_true", help="end when whoever started this is gone"
    )
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar=f"{name}[=VALUE]@START[-END|+DURATION]",
        help="repeatable; times like 5s, 250ms, 1m",
    )
    parser.add_argument(
        "--period",
        type=_period_s,
        default=PERIOD_S,
        metavar="TIME",
        help="between two handings-over of bytes, 0.5ms..100ms (default: 2ms); USB's is 1ms",
    )
    parser.add_argument("--list-faults", action="store_true", help="print all faults, and end")


def _period_s(text: str) -> float:
    try:
        period_s = seconds_from_text(text)
    except FaultError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    if not SHORTEST_S <= period_s <= LONGEST_S:
        raise argparse.ArgumentTypeError(f"must be from 0.5ms to 100ms, is {text}")
    return period_s


def say(who: str, text: str) -> None:
    sys.stderr.write(f"{who}: {text}\n")
    sys.stderr.flush()


def serve(
    who: str,
    given: argparse.Namespace,
    stop: Stop,
    ports: Mapping[str, str | None],
    wires: Sequence[TcpWire | PtyWire],
    targets: Mapping[str, Sequence[object]],
    step: Callable[[float], None],
) -> None:
    """Say where all is, and serve it until there is a reason to end.

    Args:
        targets: what faults are for, as `Schedule` takes them.
        step: of what stands behind the devices; it comes before the wires.

    Raises:
        FaultError: an order that cannot be carried out.
    """
    schedule = Schedule([order_from_text(text) for text in given.fault], targets)
    if given.list_faults:
        sys.stdout.write(f"{list_of_all(targets)}\n")
        return
    sys.stdout.write(f"{json.dumps(ports)}\n")
    sys.stdout.flush()
    gc.collect()
    gc.freeze()
    begin_s = due_s = stdin_due_s = time.monotonic()
    end_s = begin_s + given.seconds if given.seconds is not None else float("inf")
    pace, kept_up = Pace(begin_s), True
    while not stop.told and (host_s := time.monotonic()) < end_s:
        if not pace.step(host_s) and kept_up:
            kept_up = False
            say(who, "this machine is too slow, the world lags")
        for told in schedule.step(pace.now_s):
            say(who, told)
        step(pace.now_s)
        for wire in wires:
            wire.step(pace.now_s)
            while wire.news:
                news = wire.news.popleft()
                if given.tell:
                    say(who, news)
        if given.until_stdin_closes and host_s >= stdin_due_s:
            stdin_due_s = host_s + STDIN_EVERY_S
            if _stdin_closed():
                break
        due_s = max(due_s + given.period, time.monotonic() - given.period)
        time.sleep(max(0.0, due_s - time.monotonic()))


def _stdin_closed() -> bool:
    """True once the other end of the standard input is gone; what arrives there is dropped."""
    readable, _, _ = select.select([sys.stdin], [], [], 0.0)
    return bool(readable) and not os.read(sys.stdin.fileno(), 4096)
