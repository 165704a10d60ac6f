"""Which query goes out next on a line of 960 characters/s, one at a time.

Characters of an exchange: what is sent, one for the echo of its last, and the answer (section 10).
    one counter of n digits            4 + 1 + n + 1       12 at n = 6
    ?E ?A ?M, each 2 s                 3 + 1 + 6 = 10      15 characters/s in all
    ^89, each s, with its optional +   4 + 1 + 3 + 2 = 10  10
    ?I, each s                         3 + 1 + 9 = 13      13
    motor command, two each 0.4 s      5 + 1 + 2 = 8       40; at a change each 50 ms 320
so both counters fit (960 - 38) / (2 (6 + n)) times a second: 46.1 at 4 digits, 38.4 at 6, 32.9 at
8; with motors kept running 44.1, 36.8, 31.5; with motors that change all the time 30.1, 25.1, 21.5.
That is reached where the loop wakes for each answer, and sends the next query at that instant. The
controller's own delay, and a loop that looks only now and then, lengthen every exchange: what fits
is therefore reckoned from how long exchanges really take. Where little fits, slow values wait: at
most one goes out between two pairs that are due, so a pair never takes longer than three exchanges
(and the motors' commands), and their periods stretch evenly.
Source: AX3500 sheet, section 10.
"""

import math

from hw.ax3500.lines import CHARACTER_S, READ_COUNTER

SLOW_S = {"^89": 1.0, "?I": 1.0, "?E": 2.0, "?A": 2.0, "?M": 2.0}  # query: its period
SLOW_HZ = sum(1.0 / period_s for period_s in SLOW_S.values())
MAY, MUST = 0.6, 0.85  # of its period: fills a gap from then on, goes first from then on
REFUSED_S = 30.0  # to the next try of what the controller refuses
SMOOTHING = 0.05
PLAY = 0.2  # of a pair's period: it goes so much sooner or later where the loop is awake anyway
JUDGE_S, REJUDGE_S = 5.0, 10.0  # from the beginning to the first remark, and to each next
ENOUGH, ENOUGH_AGAIN = 0.95, 0.98  # of the pairs asked; the second ends a complaint
NEWS = 0.15  # share by which the pairs that fit must change to be told anew
REFRESH_S, CHANGE_S = 0.4, 0.05  # of motor commands


class Schedule:
    """Counters at their pace, slow values in the gaps, and before them only when overdue."""

    def __init__(self, poll_hz: float) -> None:
        self._poll_hz, self._play_s = poll_hz, PLAY / poll_hz
        self._pair_due_s = 0.0
        self._second = False  # of a pair is next
        self._slow_went = False  # since the last pair
        self.judge_s, self._told_fits = 0.0, math.inf  # pairs/s in the remark; inf: none
        self.remark = ""  # where less fits than is asked
        self.look_by_s = -math.inf  # see `maybe_next`
        self._asked_s: dict[str, float] = {}
        self._slow_due_s = 0.0  # when the first of the slow ones may fill a gap
        self._pair_s = 2 * 12 * CHARACTER_S  # smoothed

    def begin(self, now_s: float) -> None:
        """Counters first; slow values are spread over their first period."""
        self._pair_due_s, self._second, self._slow_went = now_s, False, False
        self.judge_s, self._told_fits, self.remark = now_s + JUDGE_S, math.inf, ""
        for k, (query, period_s) in enumerate(SLOW_S.items()):
            self._have_asked(query, now_s - period_s * MAY + 0.1 + 0.05 * k)

    def maybe_next(self, now_s: float) -> str | None:
        """The query that is due; None: wait.

        With a counter `look_by_s` is set: until when its answer may lie in the line, and the pace
        is kept. There must be time for the pair's second one then, before the next pair is due.
        """
        if self._second:
            self._second, self.look_by_s = False, self._pair_due_s + self._play_s
            return READ_COUNTER[0]
        is_due = now_s >= self._pair_due_s - self._play_s
        slow, age = self._oldest(now_s) if now_s >= self._slow_due_s else ("", 0.0)
        if age >= MUST and not (is_due and self._slow_went):
            return self._ask(slow, now_s)
        if is_due:
            period_s = 1.0 / self._poll_hz
            self._pair_due_s = max(self._pair_due_s + period_s, now_s - period_s)
            self._second, self._slow_went = True, False
            self.look_by_s = self._pair_due_s - self._pair_s / 2.0
            return READ_COUNTER[1]
        gap_s = self._pair_due_s - now_s
        if age >= MAY and gap_s > 0.5 * self._pair_s:
            return self._ask(slow, now_s)
        return None

    @property
    def due_s(self) -> float:
        """When to ask `maybe_next` again after it gave None, if nobody does so before."""
        return self._pair_due_s + self._play_s

    def _oldest(self, now_s: float) -> tuple[str, float]:
        """The slow query that has waited longest, and how much of its period."""
        ages = {query: (now_s - self._asked_s[query]) / SLOW_S[query] for query in SLOW_S}
        slow = max(ages, key=ages.__getitem__)
        return slow, ages[slow]

    def _ask(self, query: str, now_s: float) -> str:
        self._have_asked(query, now_s)
        self._slow_went = True
        return query

    def _have_asked(self, query: str, now_s: float) -> None:
        self._asked_s[query] = now_s
        self._slow_due_s = min(at_s + MAY * SLOW_S[slow] for slow, at_s in self._asked_s.items())

    def refused(self, query: str, now_s: float) -> None:
        """The controller does not know a slow query: seldom again."""
        self._have_asked(query, now_s + REFUSED_S)

    def counter_took(self, took_s: float) -> None:
        self._pair_s += SMOOTHING * (2.0 * took_s - self._pair_s)

    def judge(self, now_s: float, motors_hz: float) -> None:
        """From `judge_s` on: find the remark; motors_hz: commands of both channels.

        Judged when the measure has settled and seldom afterwards, so that it stays readable.
        """
        self.judge_s, fits = now_s + REJUDGE_S, self.fits_per_s(motors_hz)
        if fits >= (ENOUGH_AGAIN if self.remark else ENOUGH) * self._poll_hz:
            self._told_fits, self.remark = math.inf, ""
        elif abs(fits - self._told_fits) > NEWS * fits:
            self._told_fits = fits
            self.remark = f"{self._poll_hz:g} pairs/s asked, {fits:.0f} fit"

    def fits_per_s(self, motors_hz: float) -> float:
        """Pairs a second beside slow values and motors, as long as exchanges really take."""
        exchange_s = self._pair_s / 2.0  # a slow one takes about as long as one counter's
        exchanges = max(0.0, 1.0 / exchange_s - 2.0 * motors_hz)  # a second, beside the motors'
        return max((exchanges - SLOW_HZ) / 2.0, exchanges / 3.0)  # the second: one slow each pair
