"""In which order, and from which end, pieces are swept, so that the ways between are short.

Each piece may be done in some variants, each with an entry and an exit. A generalised travelling
salesman's tour: nearest neighbour first, then pieces are turned over, moved, and stretches reversed
as long as that helps; then kicks by a fixed seed. The work is bounded by counts, not by a clock.
Source: Croes, A method for solving travelling-salesman problems, 1958 (2-opt); Or, 1976.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from core.records import F64

I64 = npt.NDArray[np.int64]
Stop = tuple[int, int]  # piece, variant
KICKS, SEED = 10, 1
LEAST_M = 1e-6


def _columns(variants: Sequence[tuple[int, int, float]]) -> tuple[I64, I64, F64]:
    """Entries, exits and lengths of a piece's variants, (n,) each."""
    entries, exits, metres = zip(*variants, strict=True)
    return np.array(entries), np.array(exits), np.array(metres)


class Tour:
    """Pieces with their variants, and what it costs to get from each to each.

    Args:
        variants: of each piece (entry, exit, length): numbers of points, and metres within;
            number 2 k + 1 is number 2 k driven the other way round.
        between: (n, n) metres from point to point.
        start, end: points where the tour begins and is to end; None: anywhere.
    """

    def __init__(
        self,
        variants: Sequence[Sequence[tuple[int, int, float]]],
        between: F64,
        start: int | None,
        end: int | None,
    ) -> None:
        self.variants = variants
        self._far = between
        self._between: list[list[float]] = between.tolist()  # the same, for one at a time
        self._ends = [_columns(each) for each in variants]
        self._start, self._end = start, end

    def _hop(self, a: Stop | None, b: Stop | None) -> float:
        """From the exit of one to the entry of the next; None: start or end of the tour."""
        if a is None and b is None:
            return 0.0
        if a is None or b is None:
            point = self._start if a is None else self._end
            if point is None:
                return 0.0
            stop = b if a is None else a
            assert stop is not None
            at = self.variants[stop[0]][stop[1]]
            return self._between[point][at[0]] if a is None else self._between[at[1]][point]
        exit_ = self.variants[a[0]][a[1]][1]
        return self._between[exit_][self.variants[b[0]][b[1]][0]]

    def length(self, stops: Sequence[Stop]) -> float:
        hops = sum(self._hop(a, b) for a, b in zip([None, *stops], [*stops, None], strict=True))
        return hops + sum(self.variants[p][v][2] for p, v in stops)

    def _reversed(self, stops: Sequence[Stop]) -> list[Stop]:
        return [(p, v ^ 1) for p, v in reversed(stops)]

    def _nearest_first(self) -> list[Stop]:
        left, stops = set(range(len(self.variants))), list[Stop]()
        while left:
            last = stops[-1] if stops else None
            nexts = [(p, v) for p in sorted(left) for v in range(len(self.variants[p]))]
            stops.append(
                min(nexts, key=lambda s: self._hop(last, s) + self.variants[s[0]][s[1]][2])
            )
            left.remove(stops[-1][0])
        return stops

    def _choose_variants(self, stops: list[Stop]) -> list[Stop]:
        """The best variant of each piece for this order, exactly: the shortest path by layers."""
        via: list[npt.NDArray[np.intp]] = []
        costs = self._ways_to(None, stops[0][0])[0]
        for (a, _), (b, _) in pairwise(stops):
            through = costs[:, None] + self._ways_to(a, b)
            via.append(through.argmin(axis=0))
            costs = through.min(axis=0)
        last = stops[-1][0]
        v = int((costs + self._ways_home(last)).argmin())
        chosen: list[Stop] = [(last, v)]
        for k in reversed(range(len(via))):
            v = int(via[k][v])
            chosen.append((stops[k][0], v))
        return chosen[::-1]

    def _ways_to(self, a: int | None, b: int) -> F64:
        """(n, m) metres from each exit of a piece to each entry of another, and through that."""
        entries, _, through = self._ends[b]
        if a is None:
            hop = np.zeros(len(entries)) if self._start is None else self._far[self._start, entries]
            return (hop + through)[None]
        return np.asarray(self._far[np.ix_(self._ends[a][1], entries)] + through)

    def _ways_home(self, piece: int) -> F64:
        """(n,) metres from each exit of a piece to where the tour ends."""
        exits = self._ends[piece][1]
        return np.zeros(len(exits)) if self._end is None else self._far[exits, self._end]

    def _reverse_stretches(self, stops: list[Stop]) -> bool:
        """2-opt. Whether something was gained; `stops` is changed."""
        gained = False
        for i in range(len(stops)):
            before = stops[i - 1] if i else None
            for j in range(i, len(stops)):
                behind = stops[j + 1] if j + 1 < len(stops) else None
                first, last = stops[i], stops[j]
                turned = (
                    (last[0], last[1] ^ 1),
                    (first[0], first[1] ^ 1),
                )
                now = self._hop(before, first) + self._hop(last, behind)
                then = self._hop(before, turned[0]) + self._hop(turned[1], behind)
                if then < now - LEAST_M:
                    stops[i : j + 1] = self._reversed(stops[i : j + 1])
                    gained = True
        return gained

    def _move_stretches(self, stops: list[Stop]) -> bool:
        """Or-opt: up to three pieces to another place, in either direction."""
        gained = False
        for size in (1, 2, 3):
            for i in range(len(stops) - size + 1):
                part = stops[i : i + size]
                rest = stops[:i] + stops[i + size :]
                ends = [None, *rest, None]
                gain = (
                    self._hop(ends[i], part[0])
                    + self._hop(part[-1], ends[i + 1])
                    - self._hop(ends[i], ends[i + 1])
                )
                if gain <= LEAST_M:
                    continue
                best, where, how = gain - LEAST_M, -1, part
                for way in (part, self._reversed(part)):
                    for k in range(len(rest) + 1):
                        a, b = ends[k], ends[k + 1]
                        cost = self._hop(a, way[0]) + self._hop(way[-1], b) - self._hop(a, b)
                        if cost < best:
                            best, where, how = cost, k, way
                if where >= 0:
                    stops[:] = rest[:where] + how + rest[where:]
                    gained = True
        return gained

    def _improved(self, stops: list[Stop]) -> list[Stop]:
        while True:
            before = self.length(stops)
            stops = self._choose_variants(stops)
            self._reverse_stretches(stops)
            self._move_stretches(stops)
            if self.length(stops) > before - LEAST_M:
                return stops

    def best(self) -> list[Stop]:
        """A short tour. The same pieces give the same tour."""
        if not self.variants:
            return []
        best = self._improved(self._nearest_first())
        random = np.random.default_rng(SEED)
        kicks = KICKS if len(best) >= 8 else 0
        kicks = min(kicks, 20000 // len(best) ** 2)
        for _ in range(kicks):
            a, b, c = sorted(random.choice(np.arange(1, len(best)), 3, replace=False).tolist())
            other = self._improved(best[:a] + best[b:c] + best[a:b] + best[c:])
            if self.length(other) < self.length(best) - LEAST_M:
                best = other
        return best
