"""The fake Roboteq AX3500 as a program, on a pty or TCP: see `--help`."""

import argparse
import sys

from fakes.ax3500.device import FakeAx3500
from fakes.ax3500.properties import MODES, PROFILES
from fakes.programs.program import Built, parser_of, run, world_of
from fakes.world.simple import COUNTS_PER_S, TwoWheels


def _build(given: argparse.Namespace) -> Built:
    world = TwoWheels(given.counts_per_s) if given.scene == "free" else world_of(given)
    wheels = world if isinstance(world, TwoWheels) else world.wheels
    fake = FakeAx3500(wheels, given.seed, given.mode, model=given.model, paced=not given.unpaced)
    fake.load_a = 12.0
    return fake, world.step_to


def main() -> int:
    parser = parser_of("ax3500", None, ("free",))
    parser.add_argument("--model", choices=tuple(PROFILES), default="AX3500")
    parser.add_argument("--mode", choices=MODES, default="rs232", help="as stored in it")
    parser.add_argument("--counts-per-s", type=float, default=COUNTS_PER_S, help="at full power")
    parser.add_argument("--unpaced", action="store_true", help="characters take no time")
    return run("ax3500", parser, _build)


if __name__ == "__main__":
    sys.exit(main())
