"""Where a cart on a rail stands, as typed: mapod maps with a place that nobody else measures.

For a robot without wheels ([motion] source = "external", as in robots/cart.toml). Type the distance
along the rail, in metres, when the cart stands there; Enter alone is one step farther. From then on
the sensors' scans are mapped for a second. Between two distances nobody knows where the cart is:
nothing is mapped, and the map is kept. Ctrl-D or Ctrl-C ends it; then the map is trusted no more.
"""

import argparse
import math
import sys
import threading
from queue import SimpleQueue

from config_file import read_key
from core.config import ConfigError
from mapod_link.client import Link, open_link
from tools.cli.options import fail, number_in, parser_of

PORT = "udp://127.0.0.1:9751"
PERIOD_S = 0.05  # from pose to pose
SILENT_S = 0.5  # longer than mapod goes on without: what the cart saw on its way gets no place
MAPPED_S = 1.0
LEFT_S = 1.0  # until mapod is unsure of a place that it is told no more: 0.15 m at 0.3 m/s2
SURE_M, SURE_RAD = 0.001, math.radians(0.1)  # 1 sigma: a scale is read to a millimetre
UNSURE_M = 1.0  # 1 sigma of a place that says only that somebody is still there
MOST_M = 1000.0
FARTHEST_M = 0.4  # from one distance to the next: from 0.5 m on a pose is doubted
UNHEARD_S = 5.0


class TypedRail:
    """The distance that was typed last, and how sure it is since."""

    def __init__(self) -> None:
        self.distance_m = 0.0
        self._typed_s = math.inf

    @property
    def has_begun(self) -> bool:
        return self._typed_s < math.inf

    def stand(self, distance_m: float, now_s: float) -> None:
        """The cart stands there now. Raises ValueError: what was given, and what is allowed."""
        if not abs(distance_m) <= MOST_M:
            raise ValueError(f"must be from -{MOST_M:g} to {MOST_M:g} m, is {distance_m:g}")
        off_m = abs(distance_m - self.distance_m)
        if self.has_begun and off_m > FARTHEST_M:
            raise ValueError(
                f"must be at most {FARTHEST_M:g} m from {self.distance_m:g}, is {distance_m:g}: "
                "the map would begin anew"
            )
        self.distance_m, self._typed_s = distance_m, now_s

    def maybe_sigma_m(self, now_s: float) -> float | None:
        """Of the distance; None: not to be told."""
        since_s = now_s - self._typed_s
        if since_s < SILENT_S:
            return None
        return SURE_M if since_s < SILENT_S + MAPPED_S else UNSURE_M

    def may_move(self, now_s: float) -> bool:
        """Whether nothing is mapped any more where it stands."""
        return not self.has_begun or now_s - self._typed_s > SILENT_S + MAPPED_S + LEFT_S


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 ended, 1 the link is gone, 2 wrong use."""
    options = _options(arguments)
    try:
        link = open_link(options.port, key=read_key(options.key_file))
    except (ConfigError, ValueError, OSError) as error:
        return fail("rail", error)
    with link:
        try:
            _follow(link, options.step)
        except OSError as error:
            return fail("rail", f"{options.port}: {error}", 1)
        except KeyboardInterrupt:
            print()
    return 0


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = parser_of("rail", __doc__, "mapod rail --port udp://127.0.0.1:9751 --step 0.01")
    parser.add_port(PORT, PORT)
    parser.add_argument(
        "--step", type=number_in(-FARTHEST_M, FARTHEST_M), default=0.01,
        help="m that Enter alone goes (default: 0.01)",
    )  # fmt: skip
    parser.add_key()
    return parser.parse_args(arguments)


def _follow(link: Link, step_m: float) -> None:
    """Until no more is typed."""
    rail, lines = TypedRail(), SimpleQueue[str]()
    threading.Thread(target=_read_all, args=(lines,), daemon=True).start()
    asks, told_s, unheard_s = False, -math.inf, link.now_s() + UNHEARD_S
    while True:
        now_s = link.step(PERIOD_S / 2)
        if link.receiver.geom is None:
            if now_s > unheard_s:
                unheard_s = math.inf
                where = f"{link.url} yet: its [planner] port must name this receiver, too"
                print(f"no mapod is heard at {where}", file=sys.stderr)
            continue
        sigma_m = rail.maybe_sigma_m(now_s)
        if sigma_m is not None and now_s - told_s >= PERIOD_S:
            told_s = now_s
            link.receiver.external_pose(
                now_s, rail.distance_m, 0.0, 0.0,
                sigma_x_m=sigma_m, sigma_y_m=SURE_M, sigma_yaw_rad=SURE_RAD,
            )  # fmt: skip
        if not rail.may_move(now_s):
            continue
        if not asks:
            print("m along the rail: ", end="", flush=True)
        asks = lines.empty()
        if not asks and not _take(lines.get(), rail, step_m, now_s):
            return


def _read_all(lines: SimpleQueue[str]) -> None:
    """All that is typed, and "" at its end."""
    for line in sys.stdin:
        lines.put(line)
    lines.put("")


def _take(line: str, rail: TypedRail, step_m: float, now_s: float) -> bool:
    """Take a line; False: there are no more."""
    text, farther_m = line.strip(), rail.distance_m + step_m if rail.has_begun else 0.0
    if not line:
        return False
    try:
        distance_m = float(text) if text else farther_m
    except ValueError:
        print(f"must be a number, is {text!r}", file=sys.stderr)
        return True
    try:
        rail.stand(distance_m, now_s)
        print(f"{distance_m:g} m: is mapped, leave it there", flush=True)
    except ValueError as error:
        print(error, file=sys.stderr)
    return True
