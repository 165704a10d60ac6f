"""Writes a dump of a fake Kinect, which libfreenect's player gives as a real one: see `--help`.

python -m fakes.programs.kinect_dump --scene office --frames 60 DUMP
fakenect DUMP freenect-glview
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from fakes.kinect.device import FakeKinect
from fakes.kinect.dump import write_dump
from fakes.kinect.sensing import U16
from fakes.programs.program import met_of, stepped
from fakes.programs.serving import say
from fakes.world.simple import GROUNDS

NAME = "kinect_dump"


def frames(given: argparse.Namespace) -> Iterator[tuple[float, U16]]:
    """Seconds after the first one, and raw values. Raises ValueError, KeyError: no such scene."""
    met, world = met_of(given)
    fake, step = FakeKinect(met, given.seed), stepped(world, lambda now_s: None)
    fake.tilt_deg, fake.mount_m = given.tilt, (fake.mount_m[0], 0.0, given.height)
    for number in range(given.frames):
        t_s = number * fake.period_s
        step(t_s)
        yield t_s, fake.sensor.picture(t_s).raw


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 done, 2 refused."""
    parser = argparse.ArgumentParser(prog=f"python -m fakes.programs.{NAME}", description=__doc__)
    parser.add_argument("folder", type=Path, metavar="DUMP", help="a new folder")
    about = f"{', '.join(GROUNDS)}, or a world's (needs MuJoCo)"
    parser.add_argument("--scene", default=GROUNDS[0], help=about)
    parser.add_argument("--frames", type=int, default=30, help="30 a second (default: 30)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--height", type=float, default=0.6, help="of the lens, m (default: 0.6)")
    parser.add_argument("--tilt", type=float, default=25.0, help="looking down, deg (default: 25)")
    given = parser.parse_args(arguments)
    try:
        write_dump(given.folder, frames(given))
    except (OSError, KeyError, ValueError, ImportError) as error:
        say(NAME, f"{error}")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
