"""Closed lines to one: where two lie side by side, both are cut open and joined by two short ways.

Contours that are driven one by one cost a hop each, which sweeps hardly anything. Where a stretch
of each is left out instead and its ends are joined, the line is as long as both were, and the two
ways sweep what lies between them.
Source: Zhao et al., Connected Fermat spirals for layered fabrication, 2016; the cheapest first, as
Prim, Shortest connection networks and some generalizations, 1957.
"""

import heapq
from collections.abc import Sequence

import numpy as np

from core.paths.geometry.rings import Ring, joined, length_of
from core.paths.geometry.visibility import VisibilityGraph
from core.records import F64

LEAST = 3  # stretches of a line, so that it is not left out as a whole
OFFERS = 12  # places at which two lines may be joined, at most
MOST = 2.0  # spacings that joining two lines may cost
_Ends = tuple[F64, F64, F64]


def joined_loops(lines: Sequence[F64], graph: VisibilityGraph, spacing_m: float) -> list[F64]:
    """Closed lines (n, 2) to fewer of them, the longest first, each through one or more of those.

    New edges lie within the space; what lies too far from all others stays a line of its own.
    """
    left = dict(enumerate(_stretches(line, spacing_m) for line in lines))
    found = []
    while left:
        longest = max(left, key=lambda name: len(left[name]))
        loop = _Loop(left.pop(longest), left, graph, MOST * spacing_m)
        loop.grow()
        found.append(loop.line())
    return found


class _Loop:
    """A closed line that grows, in stretches (n, 2) end to end.

    Args:
        left: of the lines that may be joined to it, by name; what is joined is taken from it.
    """

    def __init__(
        self, first: list[F64], left: dict[int, list[F64]], graph: VisibilityGraph, most_m: float
    ) -> None:
        self._stretches: dict[int, F64] = {}
        self._order: list[int] = []
        self._count = 0
        self._left, self._graph, self._most_m = left, graph, most_m
        self._offers: list[tuple[float, int, int, int, bool]] = []
        self._put(0, first)

    def line(self) -> F64:
        return joined([self._stretches[name] for name in self._order])

    def grow(self) -> None:
        """Join what is left and near enough, the cheapest first."""
        while self._offers and self._left:
            _, stretch, name, k, is_turned = heapq.heappop(self._offers)
            if name in self._left and stretch in self._stretches:
                self._join(stretch, name, k, is_turned)

    def _put(self, place: int, stretches: list[F64]) -> None:
        """Stretches into the line, and what it costs to join the lines that are left to these."""
        names = range(self._count, self._count + len(stretches))
        self._count += len(stretches)
        self._stretches.update(zip(names, stretches, strict=True))
        self._order[place:place] = names
        ends = _ends(stretches)
        for name, other in self._left.items():
            for cost_m, i, k, is_turned in _cheapest(ends, _ends(other)):
                if cost_m < self._most_m:
                    heapq.heappush(self._offers, (cost_m, names[i], name, k, is_turned))

    def _join(self, stretch: int, name: int, k: int, is_turned: bool) -> None:
        """Another line instead of a stretch, without its own stretch k, if the new ways are clear.

        Args:
            is_turned: the other line is driven against its direction.
        """
        old, other = self._stretches[stretch], self._left[name]
        rest = [*other[k + 1 :], *other[:k]]
        if is_turned:
            rest = [each[::-1] for each in reversed(rest)]
        there, back = np.vstack([old[0], rest[0][0]]), np.vstack([rest[-1][-1], old[-1]])
        ways = np.stack([there, back])
        if not self._graph.sees(ways[:, 0], ways[:, 1]).all():
            return
        place = self._order.index(stretch)
        del self._order[place], self._stretches[stretch], self._left[name]
        self._put(place, [there, *rest, back])


def _stretches(line: F64, spacing_m: float) -> list[F64]:
    """A closed line in stretches of about one spacing: two ways so far apart sweep all between."""
    ring = Ring(line)
    count = max(LEAST, round(ring.length_m / spacing_m))
    each_m = ring.length_m / count
    return [ring.ahead(k * each_m, each_m) for k in range(count)]


def _ends(stretches: Sequence[F64]) -> _Ends:
    """First points (n, 2), last points (n, 2) and lengths (n,)."""
    first, last = (np.array([each[end] for each in stretches]) for end in (0, -1))
    return first, last, np.array([length_of(each) for each in stretches])


def _cheapest(ours: _Ends, theirs: _Ends) -> list[tuple[float, int, int, bool]]:
    """Metres more, which of our stretches, which of theirs, whether they are driven turned."""
    (a, b, ours_m), (c, d, theirs_m) = ours, theirs
    turned, ahead = _far(a, c) + _far(b, d), _far(a, d) + _far(b, c)
    cost = (np.minimum(turned, ahead) - ours_m[:, None] - theirs_m).ravel()
    count = min(OFFERS, len(cost))
    best = np.argpartition(cost, count - 1)[:count].tolist()
    places = [divmod(at, len(theirs_m)) for at in best]
    return [
        (float(cost[at]), i, k, bool(turned[i, k] < ahead[i, k]))
        for at, (i, k) in zip(best, places, strict=True)
    ]


def _far(a: F64, b: F64) -> F64:
    """(n, m) metres between points (n, 2) and (m, 2)."""
    return np.asarray(np.hypot(a[:, None, 0] - b[:, 0], a[:, None, 1] - b[:, 1]))
