"""A long run in one process: simulated driving, faults by chance, every counter over its end.

    python -m tools.rig.soak --hours 24

The robot is driven about a hall at random, minute by minute with other faults of its devices. When
these are over, all inputs must be well again within a time, the receiver's map must be the app's to
the cell, its numbers must add up, and the device clocks must stand where they stood. Memory must
not grow. Nothing is judged of where the robot goes, over unknown ground, too: campaigns do that.
One that is stuck, wedged, or has tipped over, is carried back to where it began and turned there,
and its controller is switched off and on, as a person would do it.
"""

import argparse
import math
import os
import random
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from config_file import with_changes
from core.mapping.method import MAX_SLOPE_RAD
from core.motion.odometry import Odometry
from core.records import Scan
from fakes.planner_mcu.receiver import FakePlanner
from fakes.scenes.scene import load_scene
from fakes.world.world import F64, World
from tools.rig.faults.catalogue import draw
from tools.rig.runs.loop import Loop, rig_config

LEG_S, FAULTY_S = 60.0, 25.0  # a leg, and until when its faults begin
FAULTS = 2  # of a leg
RECOVERS_S = 60.0  # at most, after a leg
LOOKED_S = 2.0  # at the clocks, once all is well
FREED_EVERY_S = 5.0  # a stalled robot, at most
BY_HAND_RADPS, BY_HAND_S = 1.0, 2.0  # more than a radian: the app must see that its gyro turns
STUCK_LEGS, STUCK_M = 3, 1.0  # a robot that has driven less in so many legs is stuck
WELL = 0x7F  # health bits 0 to 6
CODE = np.array([0, 2, 1], np.uint8)  # of the app's states 0, 1, -1 on the link
MOTIONS = ((0.6, 0.0), (0.5, 0.3), (0.5, -0.3), (-0.3, 0.0), (0.0, 0.7), (0.0, -0.7))
MOTION_S, LET_GO_S, ASK_S, VALID_S = (2.0, 6.0), 0.4, 0.1, 0.3
BEFORE_S = 200.0  # the end of a clock is so far ahead at the begin
BEFORE_COUNTS = 2000  # and that of the wheels' counters
BEFORE_SCANS = 1000  # and that of the scanner's numbers: after each Run of it
RESTARTED = 1000  # scans: who leaps by more has begun anew, and went over no end
LOOK_TICKS = 20  # at counters
DRIFT_S = 0.005  # of a device's clock, in the middle of what is seen over a few seconds
WARM_LEGS = 4  # until memory is held against what it was
GROWN_MB = 20.0  # more than this is no noise
KEPT = 64


class Wanderer(FakePlanner):
    """Asks for one motion after another, by chance, and lets go in between."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self._chance = random.Random(f"wanderer {seed}")
        self._motion = (0.0, 0.0)
        self._until_s = self._from_s = self._ask_s = -math.inf

    def poll(self, now_s: float) -> list[bytes]:
        if now_s >= self._until_s:
            self._motion = self._chance.choice(MOTIONS)
            self._from_s = now_s + LET_GO_S
            self._until_s = self._from_s + self._chance.uniform(*MOTION_S)
        if now_s >= self._ask_s:
            self._ask_s = now_s + ASK_S
            self.drive(now_s, *(self._motion if now_s >= self._from_s else (0.0, 0.0)), VALID_S)
        return super().poll(now_s)


class WatchedWorld(World):
    """Remembers when its sensors truly looked."""

    def __init__(self, *args: Any) -> None:
        self.swept_s: deque[float] = deque(maxlen=KEPT)  # first beam of each sweep
        self.sampled_s: deque[float] = deque(maxlen=KEPT)
        super().__init__(*args)
        self._home = self._data.qpos[:3].copy()

    def has_tipped(self) -> bool:
        """Whether the body leans farther than a map may be made from."""
        _, x, y, _ = self._data.qpos[3:7]
        return bool(1.0 - 2.0 * (x * x + y * y) < math.cos(MAX_SLOPE_RAD))

    def carry_home(self) -> None:
        """A person puts the robot down where it began, upright and with the heading that it has."""
        yaw = self.pose()[2]
        self._data.qpos[:3], self._data.qvel[:] = self._home, 0.0
        self._data.qpos[3:7] = math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)

    def turn_by_hand(self) -> None:
        """The person turns it, for as long as this is called at each tick."""
        self._data.qvel[5] = BY_HAND_RADPS

    def ranges_m(self, times_s: F64, bearings_rad: F64) -> F64:
        self.swept_s.append(float(times_s[0]))
        return super().ranges_m(times_s, bearings_rad)

    def motion_at(self, t_s: float) -> tuple[F64, F64, F64]:
        self.sampled_s.append(t_s)
        return super().motion_at(t_s)


@dataclass(slots=True)
class Ends:
    """How often each counter went over its end."""

    crossed: Counter[str] = field(default_factory=Counter)
    _last: dict[str, int] = field(default_factory=dict)

    def look(self, name: str, value: int, turn: int, most: int | None = None) -> None:
        """`most`: whoever counted more since the last look has begun anew."""
        last = self._last.get(name, value)
        step = min((value - last) % turn, (last - value) % turn)
        is_count = most is None or step <= most
        self.crossed[name] += abs(value - last) > turn // 2 and is_count
        self._last[name] = value


@dataclass(frozen=True, slots=True)
class LegResult:
    """What came of a leg."""

    number: int
    faults: tuple[str, ...]
    complaints: tuple[str, ...]
    recovered_s: float  # after the leg's time
    clock_errors_s: tuple[float, float]  # scanner, attitude sensor: against the truth
    resident_mb: float
    way_m: float  # so far, by the truth


def resident_mb() -> float:
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


class Soak:
    """One process's loop, a leg after the other."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        scene = load_scene("hall", seed)
        self.world = WatchedWorld(scene, seed)
        self.planner = Wanderer(seed)
        config = with_changes(rig_config(scene), robot={"unknown_stops": False})
        self.loop = Loop(
            self.world, seed, config, self.planner, start_s=2**32 / 1000 - BEFORE_S
        )  # the link's clock is before its end, and so are the devices'
        rig = self.loop.rig
        rig.scanner.clock_offset_us = 2**32 - round(BEFORE_S * 1e6)
        rig.scanner.first_scan = 2**16 - BEFORE_SCANS
        rig.ahrs.counter = 2**16 - round(100 * BEFORE_S)
        rig.drive.counter_offset = (2**31 - BEFORE_COUNTS, -(2**31) + BEFORE_COUNTS)
        self.ends, self.results = Ends(), list[LegResult]()
        self.resets = 0  # of the controller, as by a person, where counters had stood still
        self.carried = 0  # by a person, where it was stuck, wedged or lay
        self.way_m, self._place = 0.0, self.world.pose()[:2]
        self._clocks: list[list[float]] = [[], []]  # of a leg: scanner, attitude sensor
        self._first_clocks: tuple[float, float] | None = None
        self._halted, self._halts = 0, list[str]()  # by the monitor: how often, and why in this leg
        self._session = 0  # of the link, the newest that the receiver knows; 0: none yet

    def legs(self, seconds: float) -> Iterator[LegResult]:
        """For as much simulated time, in whole legs."""
        while self.loop.since_begin_s < seconds:
            if self._is_stuck():
                self._carry_home()
                self._recover(self.loop.now_s + RECOVERS_S)
            result = self._leg(len(self.results))
            self.results.append(result)
            yield result

    def _is_stuck(self) -> bool:
        ways_m = [result.way_m for result in self.results[-STUCK_LEGS - 1 :]]
        return len(ways_m) > STUCK_LEGS and ways_m[-1] - ways_m[0] < STUCK_M

    def _is_wedged(self) -> bool:
        """Its wheels have turned, and it has not: the app waits for its gyro to turn."""
        odometry = self.loop.app.mapper.odometry
        assert isinstance(odometry, Odometry)
        return odometry.wheels.ignored

    def _carry_home(self) -> None:
        self.world.carry_home()
        self._place = self.world.pose()[:2]
        self.loop.rig.drive.reset(self.loop.now_s)
        self.carried += 1
        for _ in range(round(BY_HAND_S * self.loop.config.loop.rate_hz)):
            self.world.turn_by_hand()
            self._run(1.0 / self.loop.config.loop.rate_hz)

    def _leg(self, number: int) -> LegResult:
        faults = tuple(draw(self._seed * 100_003 + number, FAULTS, 2.0, FAULTY_S))
        self.loop.set_faults(faults)
        self._run(LEG_S)
        self.loop.set_faults(())
        self.loop.happened.clear()
        ended_s = self.loop.now_s
        self._recover(ended_s + RECOVERS_S)
        self._clocks = [[], []]
        self._run(LOOKED_S)
        if self.loop.app.pilot.stalled or self.world.has_tipped() or self._is_wedged():
            # meanwhile: no complaint
            self._recover(self.loop.now_s + RECOVERS_S)
        scanner_s, ahrs_s = (float(np.median(errors or [np.nan])) for errors in self._clocks)
        return LegResult(
            number,
            faults,
            tuple(self._complaints(scanner_s, ahrs_s)),
            self.loop.now_s - ended_s - LOOKED_S,
            (scanner_s, ahrs_s),
            resident_mb(),
            self.way_m,
        )

    def _recover(self, until_s: float) -> None:
        """Let all be well again; a person frees a robot that is stalled, lies or is wedged."""
        freed_s = -math.inf
        while not self._is_well() and self.loop.now_s < until_s:
            if self.world.has_tipped() or self._is_wedged():
                self._carry_home()
            if self.loop.app.pilot.stalled and self.loop.now_s - freed_s > FREED_EVERY_S:
                freed_s = self.loop.now_s
                self.loop.rig.drive.reset(freed_s)
                self.resets += 1
            self._run(0.1)

    def _run(self, seconds: float) -> None:
        for _ in range(round(seconds * self.loop.config.loop.rate_hz)):
            self.loop.step()
            if self.loop.ticks % LOOK_TICKS == 0:
                self._look()

    def _look(self) -> None:
        loop, app, ends = self.loop, self.loop.app, self.ends
        head, encoders = loop.rig.scanner.head, loop.rig.drive.encoders
        if app.monitor.halts != self._halted:
            self._halted = app.monitor.halts
            self._halts.append(app.monitor.why or "the commander has let go since")
        scan, numbers = app.mapper.newest_scan, self.planner.numbers
        ends.look("scanner, microseconds", head.uptime_us(head.clock.device_s) % 2**32, 2**32)
        ends.look("attitude sensor, samples", loop.rig.ahrs.counter, 2**16)
        for channel in (0, 1):
            count = encoders.maybe_read(channel, loop.now_s)
            ends.look(f"wheel {channel + 1}, counts", count or 0, 2**32)
        ends.look("link, numbers of frames", numbers.last, 2**16)
        ends.look("link, milliseconds", round(loop.now_s * 1000) % 2**32, 2**32)
        if self.planner.geom is not None:
            self.ends.crossed["link, sessions"] += self._has_begun(self.planner.geom.session)
        place = self.world.pose()[:2]
        self.way_m, self._place = self.way_m + math.dist(place, self._place), place
        if scan is not None:
            ends.look("scanner, scans", scan.counter, 2**16, RESTARTED)
            if isinstance(scan, Scan):
                self._clocks[0].append(_off_s(self.world.swept_s, scan.t_s))
        self._clocks[1].append(_off_s(self.world.sampled_s, app.mapper.attitudes.newest_s))

    def _has_begun(self, session: int) -> bool:
        last, self._session = self._session, session
        return last not in (0, session)

    def _is_well(self) -> bool:
        """All inputs, by the newest that the planner heard, and nothing missing of its map."""
        planner, now_s = self.planner, self.loop.now_s
        if planner.pose is None or planner.stale(now_s) or planner.suspect or planner.blank:
            return False
        return planner.pose.health & WELL == WELL and self._differing() == 0

    def _differing(self) -> int:
        """Cells that the receiver holds otherwise than the app."""
        told = CODE[self.loop.map_now()]
        held = self.planner.window()
        return int((told != held).sum()) if told.shape == held.shape else told.size

    def _complaints(self, scanner_s: float, ahrs_s: float) -> Iterator[str]:
        loop, app, planner = self.loop, self.loop.app, self.planner
        if not self._is_well():
            word = planner.pose.health if planner.pose is not None else 0
            yield (
                f"not well: health {word:#x}, stale {planner.stale(loop.now_s)}, "
                f"suspect {planner.suspect}, {self._differing()} cells differ"
            )
        if app.loop.ticks != loop.ticks:
            yield f"{app.loop.ticks} ticks counted, there were {loop.ticks}"
        sent, taken = app.planners.counters["frames_sent"], planner.numbers.taken
        if not sent - 200 <= taken + planner.ignored.types <= sent:
            yield f"{sent} frames were sent, {taken} counted"
        counts = app.mapper.counts
        scans = counts.scans_added + counts.scans_dropped + counts.scans_tilted + counts.scans_early
        if scans > 25.2 * loop.since_begin_s + 4:
            yield f"{scans} scans came in {loop.since_begin_s:.0f} s"
        while self._halts:
            yield f"the monitor halted the robot: {self._halts.pop()}"
        now = scanner_s, ahrs_s
        first = self._first_clocks = self._first_clocks or now
        for name, error_s, first_s in zip(("scanner", "attitude"), now, first, strict=True):
            if not abs(error_s - first_s) <= DRIFT_S:
                yield f"the {name}'s clock is off by {error_s:.4f} s, it was by {first_s:.4f} s"

    def grown_mb(self) -> float:
        """Since it was warm, by the middles of the first and the last quarter of the legs."""
        held = [result.resident_mb for result in self.results[WARM_LEGS:]]
        quarter = max(1, len(held) // 4)
        return float(np.median(held[-quarter:]) - np.median(held[:quarter])) if held else 0.0

    def summary(self) -> list[str]:
        """Lines for a person."""
        hours, results = self.loop.since_begin_s / 3600.0, self.results
        errors_ms = 1000 * np.array([result.clock_errors_s for result in results])
        spread = np.nanmax(errors_ms, axis=0) - np.nanmin(errors_ms, axis=0)
        counters = self.loop.app.planners.counters
        return [
            f"{hours:.2f} simulated hours, {len(results)} legs, {self.way_m:.0f} m driven, "
            f"{sum(bool(result.complaints) for result in results)} legs with a complaint",
            f"memory: {results[-1].resident_mb:.0f} MB, {self.grown_mb():+.1f} MB since warm",
            f"clocks against the truth: scanner within {spread[0]:.2f} ms, attitude sensor within "
            f"{spread[1]:.2f} ms from leg to leg",
            f"slowest recovery: {max(result.recovered_s for result in results):.1f} s; "
            f"controller reset after a stall: {self.resets} times; "
            f"carried back when stuck, wedged or tipped: {self.carried} times",
            f"frames on the link: {counters['frames_sent']}",
            "ends crossed: " + "; ".join(f"{n}: {k}" for n, k in sorted(self.ends.crossed.items())),
        ]


def _off_s(true_s: deque[float], told_s: float) -> float:
    """By how much a time is off from the nearest true one."""
    return min((told_s - t_s for t_s in true_s), key=abs, default=math.nan)


def is_well(soak: Soak) -> bool:
    """No leg with a complaint, and memory that does not grow."""
    return not any(result.complaints for result in soak.results) and soak.grown_mb() < GROWN_MB


def main(arguments: list[str], say: Callable[[str], None] = print) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--hours", type=float, default=24.0, help="simulated (24)")
    parser.add_argument("--seed", type=int, default=1, help="of scene, motions and faults (1)")
    options = parser.parse_args(arguments)
    if not options.hours > 0.0:
        parser.error("--hours must be above 0")
    soak, begun_s = Soak(options.seed), time.monotonic()
    for result in soak.legs(3600.0 * options.hours):
        for complaint in result.complaints:
            say(f"leg {result.number} ({', '.join(result.faults)}): {complaint}")
        if result.number % 20 == 19:
            speed = soak.loop.since_begin_s / (time.monotonic() - begun_s)
            say(f"{soak.summary()[0]}; {result.resident_mb:.0f} MB; {speed:.1f} x real time")
    for line in [*soak.summary(), "well" if is_well(soak) else "NOT WELL"]:
        say(line)
    return 0 if is_well(soak) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
