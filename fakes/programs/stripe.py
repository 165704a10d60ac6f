"""The fake camera with a laser as a program, MJPEG over HTTP on TCP: see `--help`.

    python -m fakes.programs.stripe --port 8080 --fault ambient=sun@10s
    python -m fakes.programs.stripe --scene wall:0.8 --fault frozen@5s-8s

Any viewer of web cameras shows it: the address is http://HOST:PORT/stream.
"""

import argparse
import sys

from fakes.programs.program import Built, met_of, parser_of, run, stepped
from fakes.world.simple import GROUNDS

TCP_PORT = 8080


def _build(given: argparse.Namespace) -> Built:
    from fakes.stripe.device import FakeStripe

    if given.link:
        raise ValueError("--link: a camera is on TCP: --port")
    met, world = met_of(given)
    return FakeStripe(met, given.seed), stepped(world, lambda now_s: None)


def main() -> int:
    return run("stripe", parser_of("stripe", TCP_PORT, GROUNDS), _build)


if __name__ == "__main__":
    sys.exit(main())
