"""Any order of faults and wishes: wheels get no power on doubt, and counts stay true to them."""

import math
from typing import Literal

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from tests.support.cases import examples
from tests.support.devices.bench_ax3500 import FULL_COUNTS_PER_S, FakeBench

STOPPED = (0.0, 0.0)
DOUBT_S = 1.0  # from any doubt to wheels without power
SPOILT_S = 1.9  # where the line spoils what we say: the watchdog has to do it
TOLD_S = 1.2  # until the session has surely asked for status and stop button
COUNTS = 70.0  # less than this over an outage is not told from no travel, and a bit


class MotorLife(RuleBasedStateMachine):
    """Watches the wheels at every tick, with what truly happened at hand."""

    def __init__(self) -> None:
        super().__init__()
        self.bench = FakeBench("rc", enable=True, enter=True, max_counts_per_s=2400.0)
        self.bench.wheels.obey = True
        self.wish: tuple[float, float] | None = (0.0, 0.0)
        self.still_s = 0.0  # since when nobody wants anything
        self.well_s = 0.0  # when something was wrong last
        self.spoilt_s = -math.inf  # when the line spoilt our words last
        self.stopped_s = 0.0  # when the wheels had no power last
        self.locked_s = 0.0  # since when trouble was and no zero was wished after it; inf: not
        self.truth: dict[int, tuple[float, float]] = {}  # restarts -> measured less true
        self.slow = False  # the line has been late or has lost a zero unseen
        self.run(2.5)
        self.wish = (0.5, 0.5)
        self.run(0.5)

    # ---- what happens

    @rule(power=st.sampled_from([0.3, -0.6, 1.0]), turning=st.booleans())
    def push(self, power: float, turning: bool) -> None:
        self.wish = (power, -power / 2 if turning else power)

    @rule()
    def let_go(self) -> None:
        self.wish = (0.0, 0.0)

    @rule(nonsense=st.booleans())
    def vanish(self, nonsense: bool) -> None:
        self.wish = (math.nan, 0.5) if nonsense else None

    @rule(mute=st.booleans(), cut=st.booleans())
    def silence(self, mute: bool, cut: bool) -> None:
        self.bench.fake.mute, self.bench.wire.cut = mute, cut

    @rule(rate=st.sampled_from([0.0, 0.02, 0.5]), ours=st.booleans())
    def damage(self, rate: float, ours: bool) -> None:
        wire = self.bench.wire
        wire.damage_rate, wire.host_damage_rate = (0.0, rate) if ours else (rate, 0.0)

    @rule(rate=st.sampled_from([0.0, 0.02]), delay_s=st.sampled_from([0.0, 0.04, 0.15]))
    def lose(self, rate: float, delay_s: float) -> None:
        self.bench.wire.drop_rate, self.bench.wire.delay_s = rate, delay_s

    @rule(pressed=st.booleans(), status=st.sampled_from([0x00, 0x01, 0x08]))
    def complain(self, pressed: bool, status: int) -> None:
        self.bench.fake.emergency_stop, self.bench.fake.status = pressed, status

    @rule(pressed=st.booleans())
    def hold_up(self, pressed: bool) -> None:
        """Trouble that has come and gone while somebody may still push the stick."""
        fake = self.bench.fake
        fake.emergency_stop, fake.status = pressed, 0x02
        self.run(1.5)
        fake.emergency_stop, fake.status = False, 0x00
        self.run(0.5)

    @rule(how=st.sampled_from(["reset", "power_cycle", "rc", "W"]), driving=st.booleans())
    def strike(self, how: Literal["reset", "power_cycle", "rc", "W"], driving: bool) -> None:
        """At once; driving: on a healthy vehicle under way, with the stick still pushed."""
        if driving:
            self.mend()
        fake = self.bench.fake
        match how:
            case "power_cycle":
                fake.power_cycle(self.bench.now_s)
            case "W":
                fake.send_w()
            case _:
                fake.reset(self.bench.now_s)
                fake.mode = "rc" if how == "rc" else fake.mode
        clean = not self.is_line_ill()
        if clean:
            self.lock()
        self.slow = self.slow or not clean
        self.run(2.5 if driving else 0.3)

    @rule(seconds=st.sampled_from([0.03, 0.4, 1.5]))
    def wait(self, seconds: float) -> None:
        self.run(seconds)

    @rule()
    def mend(self) -> None:
        """All faults gone: it runs again, and the wheels do what is wanted anew."""
        bench, fake, wire = self.bench, self.bench.fake, self.bench.wire
        fake.mute = wire.cut = fake.emergency_stop = False
        wire.delay_s = wire.damage_rate = wire.host_damage_rate = wire.drop_rate = 0.0
        fake.status = 0
        if fake.encoders.hung:  # by a Z or an address that the damage made: nothing else helps
            fake.power_cycle(bench.now_s)
        self.run(4.5)
        assert bench.ax.status.state == "running"
        self.wish = (0.0, 0.0)
        self.run(0.6)
        self.wish = (0.5, 0.5)
        self.run(0.5)
        assert bench.wheels.power() == pytest.approx((0.5, 0.5), abs=0.01)
        assert bench.ax.trouble == ""

    # ---- what must hold

    def is_line_ill(self) -> bool:
        wire = self.bench.wire
        rates = wire.damage_rate + wire.host_damage_rate + wire.drop_rate
        return bool(self.bench.fake.mute or wire.cut or wire.delay_s or rates)

    def is_anything_ill(self) -> bool:
        fake, wire = self.bench.fake, self.bench.wire
        dead = fake.mute or wire.cut or wire.delay_s > 0.1 or wire.damage_rate > 0.1
        lost = self.bench.ax.status.state != "running"
        return bool(dead or lost or wire.host_damage_rate > 0.1 or fake.condition())

    def lock(self) -> None:
        self.locked_s = min(self.locked_s, self.bench.now_s)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / self.bench.tick_s)):
            self.check(*self.tick())

    def tick(self) -> tuple[float, float]:
        """One step of all; since when nobody wants anything, and something is wrong."""
        bench, wire = self.bench, self.bench.wire
        measured = bench.tick(self.wish)
        now_s = bench.now_s
        wanted = self.wish is not None and all(map(math.isfinite, self.wish)) and any(self.wish)
        self.still_s = now_s if wanted else self.still_s
        if wire.host_damage_rate:
            self.spoilt_s = now_s
        self.well_s = self.well_s if self.is_anything_ill() else now_s
        if now_s - self.well_s > TOLD_S:
            self.lock()
        elif now_s == self.well_s and self.wish == STOPPED:
            self.locked_s = math.inf
        self.slow = self.slow or self.is_line_ill()
        self.compare([(counts.restarts, counts.left, counts.right) for counts in measured])
        return now_s - self.still_s, now_s - self.well_s

    def check(self, still_for_s: float, ill_for_s: float) -> None:
        """No power to the wheels where there must be none.

        A line that spoils what we say may make a command of a zero (the fake knows no parity), so
        there the wheels may jerk anew; never for longer than the watchdog needs.
        """
        now_s = self.bench.now_s
        spoilt = now_s - self.spoilt_s < SPOILT_S
        if self.bench.wheels.power() == STOPPED:
            self.stopped_s = now_s
        must_stop = still_for_s > DOUBT_S or ill_for_s > TOLD_S or now_s - self.locked_s > DOUBT_S
        assert not must_stop or now_s - self.stopped_s <= (SPOILT_S if spoilt else 0.0)

    def compare(self, measured: list[tuple[int, float, float]]) -> None:
        """Travel is the wheels' own as long as the zero is the same."""
        true = self.bench.wheels.turned
        for restarts, left, right in measured:
            zero = self.truth.setdefault(restarts, (left - true[0], right - true[1]))
            if not self.slow:
                late = FULL_COUNTS_PER_S * 0.06  # measured a bit before it is told
                assert left - true[0] - zero[0] == pytest.approx(0.0, abs=COUNTS + 2 * late)
                assert right - true[1] - zero[1] == pytest.approx(0.0, abs=COUNTS + 2 * late)

    @invariant()
    def says_nothing_that_writes(self) -> None:
        written = self.bench.port.written
        assert self.bench.fake.flash_writes == 0
        assert b"%" not in written
        assert b"!Q" not in written


TestMotorLife = MotorLife.TestCase
TestMotorLife.settings = settings(max_examples=examples(4), stateful_step_count=12)
