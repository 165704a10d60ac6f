"""Takes depth images from a port of this machine, and keeps the newest for the step.

| state     | what it does                               | what ends it                        |
|-----------|--------------------------------------------|-------------------------------------|
| STARTING  | asks for the stream, once                  | the first good image                |
| MEASURING | takes the newest whole image of each step  | no good image for too long          |
| WAITING   | nothing; then wants a fresh connection     | a new connection, or the pause      |

An image's time is the host's own, stamped where it came into this machine; one that was on its way
for too long is refused, and so is the same picture again.
"""

import enum
import math
from typing import Any, Protocol

import numpy as np

from core.records import U16, DepthImage
from hw.depth_images.folder import CAMERA_KIND, FolderFrames
from hw.depth_images.kinect import FRAME_BYTES, KinectFrames
from hw.depth_images.options import FolderOptions, KinectOptions
from hw.depth_images.parts import Part, PartsParser
from hw.device import BadFrame, Device, DeviceStatus, Port, Reopens, Session, Tick
from hw.exchange import Exchange, StartAgainError, Steps

REQUEST = b"GET / HTTP/1.0\r\n\r\n"  # of a folder: a Kinect needs none
START_S, PAUSE_S = 8.0, 1.0
SILENCE_PERIODS, LEAST_SILENCE_S = 10, 0.5
LATE_S, EARLY_S = 0.25, 0.02  # of a stamp: a robot is elsewhere by then; a clock can't be ahead
JITTER_S = 0.005  # of an image's way into this machine
MOST_PNG = 4 << 20
PIECE = 65_536  # bytes parsed at once
SHARE_S, LEAST_SHARE = 0.3, 0.005  # of the pixels that are valid: its mean, below which is doubt
BLIND = "no pixel of the camera's image is a measurement: is it covered, or is all too far away?"
SAME = "the same picture again: the camera's picture stands still"
NO_TIME = "an image without a time"


class State(enum.Enum):
    """What a session is doing; the table above."""

    STARTING = "waiting for the first image"
    MEASURING = "measuring"
    WAITING = "waiting before a new attempt"


class Frames(Protocol):
    """Makes images of one kind of camera's parts."""

    def take(self, part: Part) -> DepthImage | BadFrame | None:
        """The image; or why it is of no use. None: what is said of the lens."""


class Newest:
    """What the session hands to the step, and hears back."""

    def __init__(self) -> None:
        self.begin()
        self.passed_over = 0  # images for which there was no step

    def begin(self) -> None:
        self.maybe_lens: Part | None = None
        self.maybe_image: Part | None = None
        self.good_s = -math.inf  # when the newest good one came
        self.complaint = ""  # of the newest bad one

    def hear(self, tick: Tick) -> list[Any]:
        for event in tick.events:
            if isinstance(event, BadFrame):
                self.complaint = event.reason
            elif event.kind == CAMERA_KIND:
                self.maybe_lens = event
            else:
                self.passed_over += self.maybe_image is not None
                self.maybe_image = event
        return tick.events


class DepthSession:
    """The conversation, from the beginning of a connection to its end."""

    def __init__(self, status: DeviceStatus, port: Port, newest: Newest, patience_s: float) -> None:
        self._status, self._port, self._newest = status, port, newest
        self._patience_s = patience_s
        self._exchange = Exchange(status, newest.hear, pause_s=PAUSE_S, longest_pause_s=PAUSE_S)

    def run(self) -> Session:
        yield from self._exchange.turn()
        while True:
            try:
                self._status.session = State.STARTING
                yield from self._start()
                self._status.session = State.MEASURING
                yield from self._deliver()
            except StartAgainError as why:
                self._status.session = State.WAITING
                self._exchange.fail(why)
                yield from self._exchange.back_off()
                if isinstance(self._port, Reopens):
                    self._port.reopen(str(why))

    def _start(self) -> Steps[None]:
        newest, exchange = self._newest, self._exchange
        until_s, out, newest.good_s = exchange.now_s + START_S, REQUEST, -math.inf
        while newest.good_s == -math.inf:
            if exchange.now_s >= until_s:
                raise StartAgainError(newest.complaint or f"no image within {START_S:g} s")
            yield from exchange.turn(out, until_s, each_step=True)
            out = b""

    def _deliver(self) -> Steps[None]:
        newest, exchange, patience_s = self._newest, self._exchange, self._patience_s
        while exchange.now_s - newest.good_s <= patience_s:
            yield from exchange.turn(b"", newest.good_s + patience_s)
        raise StartAgainError(newest.complaint or f"no image from the camera for {patience_s:g} s")


class DepthImages(Device[DepthImage]):
    """One such camera.

    Args:
        name: of its driver.
        period_s: between its images.
        most_bytes: of one of them.
        latency_s: from the middle of its exposure to its stamp.
    """

    def __init__(
        self, name: str, port: Port, frames: Frames, period_s: float, most_bytes: int,
        latency_s: float,
    ) -> None:  # fmt: skip
        self._frames, self._latency_s, self._newest = frames, latency_s, Newest()
        self._before: U16 = np.zeros((0, 0), np.uint16)
        self._number = -1
        self._share, self._share_s = 1.0, -math.inf  # of the pixels that are valid; as of when
        self.is_impaired, self.clock_locked = False, True  # stamps are of our own clock
        self.clock_uncertainty_s = JITTER_S
        status = DeviceStatus(name)
        patience_s = max(LEAST_SILENCE_S, SILENCE_PERIODS * period_s)

        def begin() -> Session:
            self._newest.begin()
            self._number = -1
            return DepthSession(status, port, self._newest, patience_s).run()

        super().__init__(
            status,
            port,
            lambda: PartsParser(most_bytes),
            begin,
            bytes_per_s=most_bytes / period_s,
            piece=PIECE,
        )

    def step(self, now_s: float) -> list[DepthImage]:
        """The newest image since the last step; none while nothing is seen in it."""
        super().step(now_s)
        newest = self._newest
        lens, newest.maybe_lens = newest.maybe_lens, None
        part, newest.maybe_image = newest.maybe_image, None
        if lens is not None and isinstance(fault := self._frames.take(lens), BadFrame):
            self._refuse(fault)
        if part is None:
            return []
        image = self._taken(part)
        if isinstance(image, BadFrame):
            self._refuse(image)
            return []
        newest.good_s, newest.complaint = now_s, ""
        self.status.state, self.status.cause = "running", ""
        self._learn_share(now_s, float(np.count_nonzero(image.numbers)) / image.numbers.size)
        if self.doubt or not image.numbers.any():  # who sees nothing is as good as silent
            return []
        self.status.heard_s = now_s
        return [image]

    def _refuse(self, fault: BadFrame) -> None:
        self.status.reject(fault)
        self._newest.complaint = fault.reason

    def _taken(self, part: Part) -> DepthImage | BadFrame:
        """The image at its instant; or why it is of no use."""
        if part.stamp_s is None:
            return BadFrame(NO_TIME, b"")
        late_s = part.began_s - part.stamp_s
        if not -EARLY_S <= late_s <= LATE_S:
            told = f"{late_s:.2g} s late" if late_s > 0.0 else f"{-late_s:.2g} s early"
            return BadFrame(f"an image that comes {told}", b"")
        made = self._frames.take(part)
        if made is None or isinstance(made, BadFrame):
            return made or BadFrame(NO_TIME, b"")
        if self._number >= 0 and part.number > self._number:
            self.status.missed += part.number - self._number - 1
        self._number = part.number
        is_same = np.array_equal(made.numbers, self._before)
        self._before = made.numbers
        if is_same and made.numbers.any():
            return BadFrame(SAME, b"")
        exposed_s = part.stamp_s - self._latency_s
        return DepthImage(exposed_s, made.numbers, made.camera, made.counter, made.arrived_s)

    def _learn_share(self, now_s: float, share: float) -> None:
        """Its mean over some time, however many images come in that."""
        weight = 1.0 - math.exp((self._share_s - now_s) / SHARE_S)
        self._share, self._share_s = self._share + weight * (share - self._share), now_s
        self.is_impaired = bool(self.doubt)

    @property
    def has_heard(self) -> bool:
        return self._newest.maybe_image is not None

    @property
    def doubt(self) -> str:
        """Why nobody may trust what it sees though images come, in words; "" if all is well."""
        return BLIND if self.status.state == "running" and self._share < LEAST_SHARE else ""

    def measured(self) -> dict[str, float]:
        return {
            "valid_share": round(self._share, 3),
            "frames_passed_over": float(self._newest.passed_over),
        }


def kinect_on(port: Port, options: KinectOptions) -> DepthImages:
    """A Kinect, whose frames a port gives."""
    frames, period_s = KinectFrames(options), options.period_s
    return DepthImages("kinect", port, frames, period_s, FRAME_BYTES, options.latency_s)


def folder_on(port: Port, options: FolderOptions) -> DepthImages:
    """Images of a folder, which a port gives."""
    return DepthImages("folder", port, FolderFrames(), options.period_s, MOST_PNG, 0.0)
