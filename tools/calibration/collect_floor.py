"""What scanner and attitude sensor see of the floor for some seconds, for `calibrate.py`.

Opens these two ports and no other, so that nothing can move. Waits until both devices run and their
clocks are known; refuses with the device's own cause where that does not come, or does not last.
"""

import contextlib
import math
import sys
import time
from dataclasses import replace

from core.config import Config
from core.motion.attitude import AttitudeRing
from core.records import Scan
from hw.device import DeviceStatus, Port
from hw.lms1xx.session import Lms111
from hw.mti.session import Mti
from hw.ports.url import parse_url
from hw.ports.wires import open_port
from tools.calibration.mount import FloorWatch

STEP_S, PROGRESS_S = 0.002, 2.0
READY_S = 45.0  # a scanner's spin-up and both clocks' first second fit in
WAIT_S = 0.3  # a scan's longest wait for the attitude of its last beam
LEAST_COVERED = 0.8  # of the scans


class RefusedError(Exception):
    """Nothing is measured, told or written; the text says why."""


class Collector:
    """Both devices on their ports, and the floor that they see, for so long once both run well."""

    def __init__(self, config: Config, scanner: Port, ahrs: Port, seconds: float) -> None:
        settings, attitude = config.scanner, config.ahrs
        self.scanner = Lms111(
            scanner,
            dialect=settings.dialect,
            scan_rate_hz=settings.scan_rate_hz,
            angular_step_deg=settings.angular_step_deg,
            first_deg=settings.first_deg,
            last_deg=settings.last_deg,
            echo="first",
            accepted_status=settings.accepted_status,
        )
        baud = parse_url(attitude.port).baud or 115_200
        self.ahrs = Mti(ahrs, rate_hz=attitude.rate_hz, baud=baud)
        self.watch = FloorWatch()
        self.done = False
        self._seconds, self._due = seconds, seconds * settings.scan_rate_hz
        self._attitudes = AttitudeRing(
            math.radians(attitude.mount_roll_deg),
            math.radians(attitude.mount_pitch_deg),
            math.radians(attitude.mount_yaw_deg),
        )
        self._waiting: list[Scan] = []
        self._begun_s = self._ready_s = math.inf
        self._dropped = 0

    def step(self, now_s: float) -> None:
        """Read, decode, collect; never waits.

        Raises:
            RefusedError: a device does not run, or not well.
        """
        self._begun_s = min(self._begun_s, now_s)
        for attitude in self.ahrs.step(now_s):
            self._attitudes.add(attitude)
        scans = self.scanner.step(now_s)
        if self._ready_s == math.inf:
            self._get_ready(now_s)
            return
        for scan in scans:
            self._waiting.append(replace(scan, ranges_m=scan.ranges_m.copy()))
        self._settle(now_s)
        if now_s >= self._ready_s + self._seconds + WAIT_S:
            self._end()

    def _get_ready(self, now_s: float) -> None:
        if self.scanner.clock_locked and self.ahrs.clock_locked:
            self._ready_s = now_s
        elif now_s - self._begun_s > READY_S:
            raise RefusedError(f"not ready within {READY_S:g} s: {self.words(now_s)}")

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

    def words(self, now_s: float) -> str:
        """How it goes, in one line."""
        if self._ready_s < math.inf:
            gone_s = min(now_s - self._ready_s, self._seconds)
            progress = f"{gone_s:.0f} of {self._seconds:.0f} s, {self.watch.scans} scans"
        else:
            progress = "waiting until both devices run and their clocks are known"
        return "; ".join([progress, *_complaints(self.scanner.status, self.ahrs.status)])


def _complaints(*devices: DeviceStatus) -> list[str]:
    names = {"lms111": "scanner", "mti": "attitude sensor"}
    return [
        f"the {names[status.name]} is {status.state}" + (f": {status.cause}" * bool(status.cause))
        for status in devices
        if status.cause or status.state != "running"
    ]


def collect(config: Config, seconds: float) -> FloorWatch:
    """What the devices of the settings see in so many seconds of real time.

    Raises:
        RefusedError, PortUrlError: see Collector; a port's URL is none.
    """
    with contextlib.ExitStack() as stack:
        scanner, ahrs = (
            stack.enter_context(contextlib.closing(open_port(url)))
            for url in (config.scanner.port, config.ahrs.port)
        )
        collector = Collector(config, scanner, ahrs, seconds)
        stack.callback(collector.scanner.stop)
        told_s = time.monotonic()
        while not collector.done:
            collector.step(time.monotonic())
            if time.monotonic() - told_s >= PROGRESS_S:
                told_s += PROGRESS_S
                print(f"calibrate: {collector.words(told_s)}", file=sys.stderr, flush=True)
            time.sleep(STEP_S)
    return collector.watch
