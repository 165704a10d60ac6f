"""The fake Xsens MTi as a program, on a pty or TCP: `python -m fakes.programs.mti --help`."""

import argparse
import struct
import sys

from fakes.programs.program import Built, parser_of, run, stepped, world_of
from fakes.world.simple import MOTIONS, Motion


def _build(given: argparse.Namespace) -> Built:
    from fakes.mti import frames
    from fakes.mti.device import FakeMti

    world = None if given.scene in MOTIONS else world_of(given)
    motion_at = Motion(given.scene).motion_at if world is None else world.motion_at
    fake = FakeMti(motion_at, given.seed, given.model)
    if given.baud is not None:
        fake.baud = given.baud

    def first(now_s: float) -> None:
        """As a person who set it before: GoToConfig, SetPeriod, GoToMeasurement."""
        if given.rate is not None:
            period = struct.pack(">H", round(115200 / given.rate))
            asked = ((0x30, b""), (0x04, period), (0x10, b""))
            fake.exchange(now_s, b"".join(frames.frame(mid, data) for mid, data in asked))

    return fake, stepped(world, first)


def main() -> int:
    parser = parser_of("mti", None, MOTIONS)
    parser.add_argument("--model", default="MTi-28", help="MTi-28 (default) or a sister")
    parser.add_argument("--baud", type=int, help="of its line (default: 115200)")
    parser.add_argument("--rate", type=int, help="Hz, as stored in it; legacy models")
    return run("mti", parser, _build)


if __name__ == "__main__":
    sys.exit(main())
