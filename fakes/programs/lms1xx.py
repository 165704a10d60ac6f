"""The fake SICK LMS1xx as a program, on TCP: `python -m fakes.programs.lms1xx --help`."""

import argparse
import struct
import sys

from fakes.programs.program import Built, parser_of, ranges_of, run, stepped
from fakes.world.simple import ROOMS


def _build(given: argparse.Namespace) -> Built:
    from fakes.lms1xx import cola
    from fakes.lms1xx.device import FakeLms111

    ranges_m_at, world = ranges_of(given)
    fake = FakeLms111(ranges_m_at, given.seed, given.model)

    def first(now_s: float) -> None:
        """As a person who set it before: login, rate and step, keep, run."""
        if given.scan_rate is not None or given.angular_step is not None:
            hundredths_hz = 100 * (given.scan_rate or (25 if given.angular_step == 0.25 else 50))
            step_raw = round(10000 * (given.angular_step or 0.5))
            scan = struct.pack(">IHIii", hundredths_hz, 1, step_raw, -450000, 2250000)
            commands = (
                b"sMN SetAccessMode " + bytes.fromhex("03 F4724744"),
                b"sMN mLMPsetscancfg " + scan,
                b"sMN mEEwriteall",
                b"sMN Run",
            )
            fake.exchange(now_s, b"".join(map(cola.frame, commands)))
        fake.binary = given.dialect == "binary"

    return fake, stepped(world, first)


def main() -> int:
    parser = parser_of("lms1xx", 2112, ROOMS)
    parser.add_argument("--model", default="LMS111", help="LMS111 (default) or a sister")
    parser.add_argument("--dialect", choices=("binary", "ascii"), default="binary")
    parser.add_argument("--scan-rate", type=int, choices=(25, 50), help="Hz, as stored in it")
    parser.add_argument("--angular-step", type=float, choices=(0.25, 0.5), help="degrees")
    return run("lms111", parser, _build)


if __name__ == "__main__":
    sys.exit(main())
