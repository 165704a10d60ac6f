"""What scanner and attitude sensor see of the floor for some seconds.

Opens these two ports and no other, so that nothing can move. Waits until both devices run and their
clocks are known; refuses with the device's own cause where that does not come, or does not last.
"""

import contextlib
import math
import time
from collections.abc import Callable

from msgspec.structs import replace

from core.config import Config
from core.motion.attitude import AttitudeRing
from core.records import Scan
from hw.device import NoPort, Port
from hw.ports.wires import open_port
from tools.calibration.mount import FloorWatch
from tools.replay.outcome import complaints_of
from wiring import Ports, devices_on

STEP_S, PROGRESS_S = 0.002, 0.2
READY_S = 45.0  # a scanner's spin-up and both clocks' first second fit in
WAIT_S = 0.3  # a scan's longest wait for the attitude of its last beam
LEAST_COVERED = 0.8  # of the scans


class RefusedError(Exception):
    """Nothing is measured, told or written; the text says why."""


class Collector:
    """Both devices on their ports, and the floor that they see, for so long once both run well."""

    def __init__(self, config: Config, scanner: Port, ahrs: Port, seconds: float) -> None:
        attitude, nowhere = config.ahrs, NoPort()
        devices = devices_on(Ports(scanner, ahrs, nowhere, nowhere), config)
        self.scanner, self.ahrs = devices.scanner, devices.ahrs
        self.watch = FloorWatch()
        self.done = False
        self._seconds, self._due = seconds, seconds / config.scanner.options.spec.period_s
        self._attitudes = AttitudeRing(
            math.radians(attitude.mount_roll_deg),
            math.radians(attitude.mount_pitch_deg),
            math.radians(attitude.mount_yaw_deg),
        )
        self._waiting: list[Scan] = []
        self._begun_s = self._ready_s = math.inf
        self._dropped = 0

    def step(self, now_s: float) -> None:
        """Never waits. Raises RefusedError: a device does not run, or not well."""
        self._begun_s = min(self._begun_s, now_s)
        for attitude in self.ahrs.step(now_s):
            self._attitudes.add(attitude)
        scans = self.scanner.step(now_s)
        if self._ready_s == math.inf:
            if self.scanner.clock_locked and self.ahrs.clock_locked:
                self._ready_s = now_s
            elif now_s - self._begun_s > READY_S:
                raise RefusedError(f"not ready within {READY_S:g} s: {self.words(now_s)}")
            return
        for scan in scans:
            if not isinstance(scan, Scan):
                raise RefusedError("only a scanner of one plane can be calibrated")
            self._waiting.append(replace(scan, ranges_m=scan.ranges_m.copy()))
        self._settle(now_s)
        if now_s >= self._ready_s + self._seconds + WAIT_S:
            self._end()

    def _settle(self, now_s: float) -> None:
        """Take the scans of which every beam's attitude is known by now."""
        waiting, self._waiting = self._waiting, []
        for scan in waiting:
            last_s = scan.t_s + (scan.ranges_m.shape[1] - 1) * scan.beam_dt_s
            if self._attitudes.covers(scan.t_s, last_s):
                self.watch.add(scan, self._attitudes)
            elif now_s - scan.arrived_s > WAIT_S:
                self._dropped += 1
            elif scan.arrived_s <= self._ready_s + self._seconds:
                self._waiting.append(scan)

    def _end(self) -> None:
        if self.watch.scans < LEAST_COVERED * self._due:
            told = self.words(self._ready_s + self._seconds)
            raise RefusedError(
                f"only {self.watch.scans} of {self._due:.0f} scans came with an attitude, "
                f"{self._dropped} without: {told}"
            )
        self.done = True

    def gone_s(self, now_s: float) -> float:
        return max(0.0, min(now_s - self._ready_s, self._seconds))

    def words(self, now_s: float) -> str:
        if self._ready_s < math.inf:
            progress = (
                f"{self.gone_s(now_s):.0f} of {self._seconds:.0f} s, {self.watch.scans} scans"
            )
        else:
            progress = "waiting until both devices run and their clocks are known"
        statuses = {"scanner": self.scanner.status, "attitude sensor": self.ahrs.status}
        return "; ".join([progress, *complaints_of(statuses)])


def collect(config: Config, seconds: float, advance: Callable[[float, str], None]) -> FloorWatch:
    """`advance` gets the seconds that count, and words. Raises RefusedError, PortUrlError."""
    with contextlib.ExitStack() as stack:
        scanner, ahrs = (
            stack.enter_context(contextlib.closing(open_port(url)))
            for url in (config.scanner.port, config.ahrs.port)
        )
        collector = Collector(config, scanner, ahrs, seconds)
        stack.callback(collector.scanner.stop)
        told_s = time.monotonic()
        while not collector.done:
            now_s = time.monotonic()
            collector.step(now_s)
            if now_s - told_s >= PROGRESS_S:
                told_s += PROGRESS_S
                advance(collector.gone_s(now_s), collector.words(now_s))
            time.sleep(STEP_S)
    return collector.watch
