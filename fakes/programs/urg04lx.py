"""The fake Hokuyo URG-04LX as a program, on a pty or TCP: see `--help`.

An Ethernet model listens on TCP 10940 unless it is told otherwise.
"""

import argparse
import sys

from fakes.programs.program import Built, parser_of, ranges_of, run, stepped
from fakes.world.simple import ROOMS

TCP_PORT = 10940


def _build(given: argparse.Namespace) -> Built:
    from fakes.urg04lx.device import FakeUrg04lx
    from fakes.urg04lx.models import MODELS

    ranges_m_at, world = ranges_of(given)
    fake = FakeUrg04lx(ranges_m_at, given.seed, given.model)
    is_ethernet = MODELS[given.model].wire == "tcp"
    if is_ethernet and given.port is None and not given.link:
        given.port = TCP_PORT
    if given.baud is not None and fake.baud is not None:
        fake.baud = given.baud
    return fake, stepped(world, lambda now_s: None)


def main() -> int:
    parser = parser_of("urg04lx", None, ROOMS)
    parser.add_argument("--model", default="URG-04LX", help="URG-04LX (default) or a sister")
    parser.add_argument("--baud", type=int, help="at which a host has left it (default: 19200)")
    return run("urg04lx", parser, _build)


if __name__ == "__main__":
    sys.exit(main())
