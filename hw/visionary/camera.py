"""A Visionary camera on its two ports: bytes in, depth images out.

It is stepped at every tick. Of the frames that came since the last step the newest is taken, so one
that looks less often sees less, and nothing piles up.
"""

import math

from core.records import DepthImage
from hw.device import BadFrame, Device, DeviceStatus, Port, Session
from hw.exchange import silent
from hw.visionary.cola import ColaParser
from hw.visionary.depth import warm
from hw.visionary.frames import FrameMaker, Passed
from hw.visionary.options import VisionaryOptions
from hw.visionary.session import Known, State, VisionarySession, warnings_of
from hw.visionary.stream import OpenAt, Stream
from hw.visionary.times import FrameTimes

READY, STANDBY = 1, 5  # deviceState, CurPwrMode
SHARE_S, LEAST_SHARE = 0.3, 0.005  # of the pixels that are valid: its mean, below which is doubt
BLIND = "no pixel of the camera's image is a measurement: is it covered, or is all too far away?"


class Visionary(Device[DepthImage]):
    """One camera.

    Args:
        port: of its control.
        open_at: gives a port of the same host for its stream, by its number.
    """

    def __init__(self, port: Port, options: VisionaryOptions, open_at: OpenAt) -> None:
        warm()
        is_cola_2 = options.control == "cola_2"
        times = FrameTimes(1000.0 * options.period_s, options.latency_s)
        frames = FrameMaker(times, options.min_confidence)
        self._known = Known(Stream(open_at), frames, times)
        self._share, self._share_s = 1.0, -math.inf  # of the pixels that are valid; as of when
        self.clock_locked = self.is_impaired = False
        status = DeviceStatus("visionary")

        def begin() -> Session:
            self._session_now = VisionarySession(status, port, options, self._known)
            return self._session_now.run()

        super().__init__(status, port, lambda: ColaParser(is_cola_2), begin)

    def step(self, now_s: float) -> list[DepthImage]:
        """The image of the newest frame since the last step, if it is of use."""
        super().step(now_s)
        self.due_s = -math.inf  # the stream is to be read at every tick
        known, status = self._known, self.status
        if status.state == "closed":  # what comes without control is not trusted
            known.stream.drop(status.cause)
        for fault in known.stream.step(now_s):
            status.reject(fault)
            known.complaint = fault.reason
        blob = known.stream.maybe_newest()
        if blob is None:
            return []
        made = known.frames.take(blob)
        status.missed = known.frames.missed
        if isinstance(made, BadFrame):
            status.reject(made)
            known.complaint = made.reason
            return []
        known.good_s, known.complaint = now_s, ""
        self.clock_locked = known.times.locked
        if isinstance(made, Passed) or status.session is not State.STREAMING:
            return []
        status.state, status.cause = "running", known.remark
        self._session_now.succeed()
        self._learn_share(now_s, known.frames.valid_share)
        if self._share < LEAST_SHARE or not made.numbers.any():
            return []  # who sees nothing is as good as silent
        status.heard_s = now_s
        return [made]

    def _learn_share(self, now_s: float, share: float) -> None:
        """Its mean over some time, however many frames come in that."""
        weight = 1.0 - math.exp((self._share_s - now_s) / SHARE_S)
        self._share, self._share_s = self._share + weight * (share - self._share), now_s
        self.is_impaired = bool(warnings_of(self._known.told) or self.doubt)

    def stop(self) -> None:
        """Before the program ends: it would go on streaming for nobody."""
        talk = self._session_now.talk
        self.port.write(talk.encode("MN", "PLAYSTOP"))
        if talk.is_open:
            self.port.write(talk.encode("Cx", ""))
        self._known.stream.close()
        self._session = silent()
        next(self._session)

    @property
    def identity(self) -> str:
        return self._known.identity

    @property
    def clock_uncertainty_s(self) -> float:
        return self._known.times.uncertainty_s

    @property
    def doubt(self) -> str:
        """Why nobody may trust what it sees though frames come, in words; "" if all is well."""
        if self.status.state != "running":
            return ""
        if self._share < LEAST_SHARE:
            return BLIND
        told = self._known.told
        if told.get("CurPwrMode") == STANDBY:
            return "the camera is in standby: its images are of no use"
        if told.get("deviceState", READY) != READY:
            return f"the camera is not ready: deviceState {told['deviceState']}"
        if status := self._known.frames.status:
            return f"the camera doubts its own images: status {status}"
        return ""

    def measured(self) -> dict[str, float]:
        known = self._known
        told = {
            "valid_share": round(self._share, 3),
            "frames_passed_over": float(known.stream.passed_over),
            "wrong_checksums": float(known.frames.wrong_checksums),
            "clock_settings": float(known.times.settings),
            "quality": float(known.frames.quality),
        }
        if "SysTemperatureCurrentValue" in known.told:
            tenths = known.told["SysTemperatureCurrentValue"]
            told["temperature_c"] = (tenths - (tenths >> 15 << 16)) / 10
        return told
