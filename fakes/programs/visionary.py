"""A fake depth camera as a program, on two TCP ports: see `--help`.

    python -m fakes.programs.visionary --fault camera.mute@5s-8s --fault stream.cut@10s-11s
    python -m fakes.programs.visionary --model s --port 2112 --scene office

The maker's own programs talk to it, too. Faults carry the name of what they are for: `camera`, or
one of the wires, `control` and `stream`.
"""

import argparse
import sys
from contextlib import ExitStack, closing

from fakes.programs.program import met_of, parser_of, stepped
from fakes.programs.serving import Stop, say, serve
from fakes.visionary.models import KINDS, STREAM_PORT
from fakes.wires.wire import TcpWire
from fakes.world.simple import GROUNDS

NAME = "visionary"


def _serve(given: argparse.Namespace, stop: Stop) -> None:
    from fakes.visionary.device import FakeVisionary

    if given.link:
        raise ValueError("--link: a camera is on TCP: --port and --stream-port")
    met, world = met_of(given)
    fake, seed = FakeVisionary(given.model, met, given.seed), given.seed
    number = KINDS[given.model].control_port if given.port is None else given.port
    with ExitStack() as opened:
        control = opened.enter_context(
            closing(TcpWire(fake.control, given.host, number, seed=seed))
        )
        stream = opened.enter_context(
            closing(TcpWire(fake.stream, given.host, given.stream_port, seed=seed + 1))
        )
        fake.warm()
        fake.memory.written["BlobTcpPortAPI"] = stream.port.to_bytes(2, "big")
        wires = {"control": control, "stream": stream}
        ports: dict[str, str | None] = {
            name: f"tcp://{wire.host}:{wire.port}" for name, wire in wires.items()
        }
        targets = {"camera": (fake,)} | {name: (wire,) for name, wire in wires.items()}
        step = stepped(world, lambda now_s: None)
        serve(NAME, given, stop, ports, [control, stream], targets, step)


def main() -> int:
    stop, parser = Stop(), parser_of(NAME, KINDS["t_mini"].control_port, GROUNDS)
    parser.set_defaults(port=None)  # the model's
    parser.add_argument(
        "--model",
        default="t_mini",
        choices=list(KINDS),
        help="which camera; the control of s and t is on 2112",
    )
    parser.add_argument(
        "--stream-port", type=int, default=STREAM_PORT, help="TCP port of its frames; 0: a free one"
    )
    given = parser.parse_args()
    try:
        _serve(given, stop)
    except (OSError, KeyError, ValueError, ImportError) as error:
        say(NAME, f"{error}")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
