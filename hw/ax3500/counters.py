"""Two absolute counters, read one after the other, as continuous travel at common instants.

The counters wrap or roll over, start from zero when their controller restarts, and are now and then
misread; what they say is believed only as far as the robot can have moved.
Source: AX3500 sheet, sections 5 and 10 ("Time stamp").
"""

import math

from msgspec import Struct

from hw.ax3500.lines import maybe_rollover, wrap_difference
from hw.device import BadFrame

MARGIN = 1.5  # above the greatest speed
SLACK = 2.0  # counts, for the grain of counters and clock
REFUSALS = 3  # in a row: then the counter is right and what we knew of it is not
STILL = 50.0  # counts; less than this over an outage is not told from no travel
NEAR_ZERO_S = 1.0  # of travel at the greatest speed, at most: what a restarted counter may show
OUTAGE_PAIRS, OUTAGE_LIMIT_S = 2.5, 1.0  # of the pace kept; and as far as a slow pace may reach
PACE_SMOOTHING = 0.2


class _Reading(Struct, frozen=True):
    t_s: float
    raw: int
    total: float  # continuous travel since an arbitrary zero


class Pair(Struct, frozen=True):
    """Travel of both channels at one instant, in counts."""

    t_s: float
    one: float
    two: float


class WheelCounters:
    """Readings of channel 0 and 1 in, pairs at the instants of channel 1 out."""

    def __init__(self, max_counts_per_s: float, outage_s: float) -> None:
        self.restarts, self.unpowered_s = 0, math.inf  # as in `WheelCounts`
        self._max_counts_per_s, self._outage_s = max_counts_per_s, outage_s
        self._last: list[_Reading | None] = [None, None]
        self._refused: list[list[int]] = [[], []]  # raw, since the last believed reading
        self._resuming: dict[int, tuple[float, int]] = {}  # t_s and raw while not tracking
        self._tracking = False
        self._zero_lost = self._by_other = False
        self._unpowered_s = math.inf  # of the zero that is lost
        self._outages_refused = 0
        self._read_s: list[float | None] = [None, None]  # each counter's newest reading, any
        self._pace_s = 0.0  # smoothed, from one reading of a counter to the next

    def forget_zero(self, unpowered_s: float = math.inf, *, by_other: bool = False) -> None:
        """The counters have lost their zero, as after a restart of the controller.

        Args:
            unpowered_s: since then the motors have had no power; inf: nobody knows.
            by_other: somebody else may have had them meanwhile.
        """
        self._zero_lost = self._last[0] is not None
        if self._zero_lost:
            self._unpowered_s = min(self._unpowered_s, unpowered_s)
            self._by_other |= by_other
        self._tracking = False
        self._resuming.clear()

    def take(self, channel: int, t_s: float, raw: int) -> Pair | BadFrame | None:
        """What one reading of channel 0 or 1 completes, or why it is not believed."""
        outage_s = max(self._outage_s, min(OUTAGE_LIMIT_S, OUTAGE_PAIRS * self._pace_s))
        before_s, self._read_s[channel] = self._read_s[channel], t_s
        if before_s is not None:  # one that answers slowly is not away: an outage follows the pace
            passed_s = min(t_s - before_s, OUTAGE_LIMIT_S / OUTAGE_PAIRS)
            self._pace_s += PACE_SMOOTHING * (passed_s - self._pace_s)
        one, two = self._last
        if not (self._tracking and one and two) or t_s - min(one.t_s, two.t_s) > outage_s:
            return self._resume(channel, t_s, raw, outage_s)
        last = two if channel else one
        travel = self._maybe_travel(last, t_s, raw)
        if travel is None:
            return self._refuse(channel, last, t_s, raw)
        self._refused[channel].clear()
        reading = _Reading(t_s, raw, last.total + travel)
        self._last[channel] = reading
        if channel or not last.t_s <= two.t_s < t_s:
            return None
        # channel 0 interpolated to the instant of the other's reading between its own two
        share = (two.t_s - last.t_s) / (t_s - last.t_s)
        return Pair(two.t_s, last.total + share * (reading.total - last.total), two.total)

    def _maybe_travel(self, last: _Reading, t_s: float, raw: int) -> int | None:
        """Counts since the last reading, if the robot can have made them."""
        bound = self._max_counts_per_s * max(0.0, t_s - last.t_s) * MARGIN + SLACK
        travel = wrap_difference(raw, last.raw)
        if abs(travel) <= bound:
            return travel
        rolled = maybe_rollover(raw, last.raw)
        return rolled if rolled is not None and abs(rolled) <= bound else None

    def _refuse(self, channel: int, last: _Reading, t_s: float, raw: int) -> BadFrame:
        self._refused[channel].append(raw)
        both_near_zero = all(
            refused and self._is_near_zero(refused[-1]) for refused in self._refused
        )
        if both_near_zero or len(self._refused[channel]) >= REFUSALS:
            self.forget_zero()
        travel, passed_s = wrap_difference(raw, last.raw), t_s - last.t_s
        reason = f"counter {channel + 1} jumped by {travel} in {passed_s:.3f} s"
        return BadFrame(reason, str(raw).encode())

    def _is_near_zero(self, raw: int, passed_s: float = NEAR_ZERO_S) -> bool:
        """Whether a counter that began from zero within passed_s can have come so far."""
        return abs(raw) <= self._max_counts_per_s * min(NEAR_ZERO_S, MARGIN * passed_s)

    def _resume(self, channel: int, t_s: float, raw: int, outage_s: float) -> BadFrame | None:
        """After an outage nothing is believed until both channels are there to be judged."""
        self._tracking = False
        self._resuming[channel] = (t_s, raw)
        if len(self._resuming) < 2:
            return None
        if abs(self._resuming[0][0] - self._resuming[1][0]) > outage_s:
            del self._resuming[1 - channel]
            return None
        fresh = [self._resuming.pop(0), self._resuming.pop(1)]
        totals = self._maybe_totals(fresh)
        if totals is None and self._last[0] is not None:
            self._outages_refused += 1
            certain = self._zero_lost or all(self._is_near_zero(raw) for _, raw in fresh)
            if not certain and self._outages_refused < REFUSALS:
                return BadFrame("counters jumped over an outage", repr(fresh).encode())
            self.restarts += 1
            self.unpowered_s = math.inf if self._by_other else self._unpowered_s
        self._last = [
            _Reading(t_s, raw, totals[k] if totals else float(raw))
            for k, (t_s, raw) in enumerate(fresh)
        ]
        self._refused = [[], []]
        self._outages_refused, self._zero_lost, self._tracking = 0, False, True
        self._unpowered_s, self._by_other = math.inf, False
        return None

    def _maybe_totals(self, fresh: list[tuple[float, int]]) -> list[float] | None:
        """Travel of both channels up to now; None where the counters do not have their old zero.

        A controller that restarted meanwhile counts from zero again, and a long outage makes any
        travel back to zero possible: both counters near zero are no coincidence.
        """
        totals: list[float] = []
        for (t_s, raw), last in zip(fresh, self._last, strict=True):
            travel = self._maybe_travel(last, t_s, raw) if last else None
            if last is None or travel is None or self._zero_lost:
                return None
            if abs(travel) > STILL and self._have_restarted(fresh):
                return None
            totals.append(last.total + travel)
        return totals

    def _have_restarted(self, fresh: list[tuple[float, int]]) -> bool:
        """Whether both can have begun anew from zero, and that explains them better than travel.

        Over a short outage, counters that were near zero already and went on away from it have
        just travelled. Were it a restart after all, the error is no more than what they had before.
        """
        onward = []
        for (t_s, raw), last in zip(fresh, self._last, strict=True):
            if last is None or not self._is_near_zero(raw, t_s - last.t_s):
                return False
            away = raw * last.raw >= 0 and abs(raw) + STILL >= abs(last.raw)
            onward.append(away and t_s - last.t_s <= 2.0 * NEAR_ZERO_S)
        return not all(onward)
