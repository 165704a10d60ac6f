"""Asks a web camera for its stream, and keeps the newest image for the step that measures in it.

| state     | what it does                               | what ends it                        |
|-----------|--------------------------------------------|-------------------------------------|
| ASKING    | GET, once                                  | the head of an answer               |
| MEASURING | takes a whole image in each step           | no good image for too long          |
| WAITING   | nothing; then wants a fresh connection     | a new connection, or the pause      |

On one connection a camera is asked once: it would not hear us over its stream. An image is decoded
in `step` alone, one a step. One more waits for the next step, if its camera stamps images: of two
that come at once without, the older one's instant is not known. What else comes is passed over, and
counted.
"""

import enum
import math
from collections import deque
from typing import Any

import numpy as np

from core.records import U8, PointSweep
from hw.device import BadFrame, Device, DeviceStatus, Port, Reopens, Session, Tick
from hw.exchange import Exchange, StartAgainError, Steps
from hw.stripe.images import MISSING, Decoder
from hw.stripe.mjpeg import Jpeg, MjpegParser, Refused, StreamBegun, encode_request
from hw.stripe.options import StripeOptions
from hw.stripe.sweep import SweepMaker
from hw.stripe.times import ImageTimes

ANSWER_S, PAUSE_S = 3.0, 1.0
SILENCE_PERIODS, LEAST_SILENCE_S = 8, 2.0
PIECE = 16_384  # bytes parsed at once
MOST_WAITING = 2  # images for a step: 100 a second come now and then two between two steps
SHARE_S, LEAST_SHARE = 0.2, 0.05  # of the columns with a line: its mean, below which is doubt
SAME = "the same image again: the camera's picture stands still"


class State(enum.Enum):
    """What a session is doing; the table above."""

    ASKING = "asking for the stream"
    MEASURING = "measuring"
    WAITING = "waiting before a new attempt"


class Newest:
    """What the session hands to the step, and hears back."""

    def __init__(self) -> None:
        self.jpegs: deque[Jpeg] = deque()  # the oldest first, at most MOST_WAITING
        self.passed_over = 0  # images for which there was no step
        self.good_s = -math.inf  # when the newest good one came
        self.complaint = ""  # of the newest bad one

    def take(self, jpeg: Jpeg) -> None:
        most = 1 if jpeg.stamp_us is None else MOST_WAITING
        while len(self.jpegs) >= most:
            self.jpegs.popleft()
            self.passed_over += 1
        self.jpegs.append(jpeg)


class StripeSession:
    """The conversation, from the beginning of a connection to its end."""

    def __init__(
        self, status: DeviceStatus, port: Port, newest: Newest, request: bytes, patience_s: float
    ) -> None:
        self._status, self._port, self._newest = status, port, newest
        self._request, self._patience_s = request, patience_s
        self._exchange = Exchange(status, self._hear, pause_s=PAUSE_S, longest_pause_s=PAUSE_S)

    def run(self) -> Session:
        yield from self._exchange.turn()
        while True:
            try:
                self._status.session = State.ASKING
                yield from self._ask()
                self._status.session = State.MEASURING
                yield from self._deliver()
            except StartAgainError as why:
                self._status.session = State.WAITING
                self._exchange.fail(why)
                yield from self._exchange.back_off()
                if self._request and isinstance(self._port, Reopens):
                    self._port.reopen(str(why))

    def _ask(self) -> Steps[None]:
        if not self._request:
            raise StartAgainError(MISSING)

        def maybe_begun(event: Any) -> StreamBegun | Refused | None:
            return event if isinstance(event, StreamBegun | Refused) else None

        answer = yield from self._exchange.ask(self._request, maybe_begun, ANSWER_S)
        if answer is None:
            raise StartAgainError("the camera does not answer")
        if isinstance(answer, Refused):
            raise StartAgainError(answer.why)

    def _deliver(self) -> Steps[None]:
        newest, exchange = self._newest, self._exchange
        newest.good_s = max(newest.good_s, exchange.now_s)
        while exchange.now_s - newest.good_s <= self._patience_s:
            yield from exchange.turn(b"", newest.good_s + self._patience_s)
        raise StartAgainError(
            newest.complaint or f"no image from the camera for {self._patience_s:g} s"
        )

    def _hear(self, tick: Tick) -> list[Any]:
        for event in tick.events:
            if isinstance(event, Jpeg):
                self._newest.take(event)
            elif isinstance(event, BadFrame):
                self._newest.complaint = event.reason
        return tick.events


class StripeScanner(Device[PointSweep]):
    """A camera on its TCP port, beside a laser that draws a line."""

    def __init__(self, port: Port, options: StripeOptions, host: str = "camera") -> None:
        """host: as the camera is to be called."""
        self._newest, self._maker = Newest(), SweepMaker(options)
        self._maker.warm()
        w, h = options.image_px
        self._decoder, self._times = Decoder((w, h)), ImageTimes(options.latency_s)
        self._before = b""  # the newest image's bytes: noise makes each differ from the last
        self._share, self._share_s = 0.0, -math.inf  # of the columns with a line; as of when
        self.is_impaired, self.clock_locked = False, True  # nothing is asked of the camera's
        request = b"" if self._decoder.is_missing else encode_request(host, options.path)
        patience_s = max(LEAST_SILENCE_S, SILENCE_PERIODS / options.rate_hz)
        status = DeviceStatus("stripe")

        def begin() -> Session:
            self._newest.jpegs.clear()
            self._newest.complaint = ""
            return StripeSession(status, port, self._newest, request, patience_s).run()

        super().__init__(
            status,
            port,
            lambda: MjpegParser(options.most_bytes),
            begin,
            bytes_per_s=options.rate_hz * options.most_bytes,
            piece=PIECE,
        )

    def step(self, now_s: float) -> list[PointSweep]:
        """The sweep of the image that waits longest; none while there is a doubt."""
        super().step(now_s)
        if not self._newest.jpegs:
            return []
        jpeg = self._newest.jpegs.popleft()
        if self._newest.jpegs:
            self.due_s = -math.inf
        taken = self._taken(jpeg)
        if isinstance(taken, BadFrame):
            self.status.reject(taken)
            self._newest.complaint = taken.reason
            return []
        image, exposed_s = taken
        sweep = self._maker.sweep(image, exposed_s, jpeg.arrived_s)
        self._newest.good_s, self._newest.complaint = now_s, ""
        self.status.state, self.status.cause = "running", ""
        self._learn_share(now_s, float(np.isfinite(sweep.ranges_m).mean()))
        if self.doubt:  # who sees nothing is as good as silent: what was free is not told any more
            return []
        self.status.heard_s = now_s
        return [sweep]

    def _learn_share(self, now_s: float, share: float) -> None:
        """Its mean over some time, however many images come in that."""
        weight = 1.0 - math.exp((self._share_s - now_s) / SHARE_S)
        self._share, self._share_s = self._share + weight * (share - self._share), now_s
        self.is_impaired = bool(self.doubt)

    def _taken(self, jpeg: Jpeg) -> tuple[U8, float] | BadFrame:
        """The image and its instant; or why it is of no use."""
        image = self._decoder.image(jpeg.data)
        if isinstance(image, BadFrame):
            return image
        is_same, self._before = jpeg.data == self._before, jpeg.data
        stripe = self._maker.maybe_stripe
        if is_same and stripe is not None and stripe.share > 0.0:  # white all over has no noise
            return BadFrame(SAME, jpeg.data)
        exposed_s = self._times.exposed_s(jpeg)
        return exposed_s if isinstance(exposed_s, BadFrame) else (image, exposed_s)

    @property
    def has_heard(self) -> bool:
        return bool(self._newest.jpegs)

    @property
    def clock_uncertainty_s(self) -> float:
        return self._times.uncertainty_s

    def measured(self) -> dict[str, float]:
        told = {
            "images_passed_over": float(self._newest.passed_over),
            "clock_restarts": float(self._times.restarts),
        }
        if (stripe := self._maker.maybe_stripe) is not None:
            told |= {
                "line_share": round(self._share, 3),
                "contrast": round(float(np.median(stripe.contrasts)), 1),
                "confidence": round(float(np.median(stripe.confidences)), 2),
            }
        return told

    @property
    def doubt(self) -> str:
        if self._share < LEAST_SHARE and self.status.state == "running":
            return "the camera sees no line of the laser: is that on, and its colour right?"
        return ""
