"""A receiver of the planner link, whole: what `Listener` knows, and all that may be answered.

It opens nothing and reads no clock; what is to be sent comes out of `poll`.
Source: planner link, sections 3, 6 and 9.
"""

import math
from collections import deque

from mapod_link import asking
from mapod_link.frames import (
    ACK,
    ASK,
    DRIVE,
    EXTERNAL_POSE,
    HELLO,
    MAP,
    MAX_FRAME,
    Frame,
    bytes_from_frame,
    signed_bytes_from_frame,
)
from mapod_link.listener import Listener
from mapod_link.serial_line import serial_from_frame
from mapod_link.tiles import MOST_CELLS, Tile

HELLO_PERIOD_S = 0.25
NOTHING_S = 1e-6  # of rounding, where ticks and periods agree
OUTBOX = 64  # frames kept for who polls too seldom; the oldest are dropped first


class Receiver(Listener):
    """A planner's end of the link, without its wire. Nothing raises on bytes.

    Args:
        nonce: random, 1 to 2^32 - 1, drawn at each start; 0 where there is no return path.
        key: 32 bytes: frames without a valid tag are dropped, answers are signed. None: no tags.
        ack_every: accepted frames per ACK; 0 sends nothing at all (a link without a return path).
        ack_period_s: an ACK at least so often.
        max_cells: of the largest window that it takes.
        poll_only: keep no map; push nothing, for all is asked for.

    Attributes:
        stopped: PLANNER_STOPPED in each ACK: the sender moves nothing while it is set.
    """

    def __init__(
        self,
        nonce: int,
        *,
        key: bytes | None = None,
        ack_every: int = 16,
        ack_period_s: float = 0.1,
        max_cells: int = MOST_CELLS,
        poll_only: bool = False,
    ) -> None:
        super().__init__(nonce, key, max_cells, poll_only)
        self.stopped = False
        self.ack_every, self.ack_period_s = ack_every, ack_period_s
        self._sent, self._unacked, self._asks = 0, 0, 0
        self._hello_due_s = self._acked_s = -math.inf
        self._hello_wanted = False
        self._outbox: deque[bytes] = deque(maxlen=OUTBOX)

    # Bytes in, bytes out

    def exchange(self, now_s: float, received: bytes) -> bytes:
        """The receiver on a serial line: what came, and what it sends until now_s."""
        self.feed_stream(now_s, received)
        return b"".join(serial_from_frame(frame) for frame in self.poll(now_s))

    def poll(self, now_s: float) -> list[bytes]:
        """Frames to send now, a datagram each; `serial_from_frame` makes them fit a serial line."""
        if not self.ack_every:
            return []
        if self._has_to_greet(now_s) and now_s >= self._hello_due_s:
            self._hello_due_s, self._hello_wanted = now_s + HELLO_PERIOD_S, False
            body = asking.hello_body(self.nonce, self.max_cells, MAX_FRAME, self.poll_only)
            self._send(now_s, HELLO, body)
        asking_period_s = self.ack_period_s / (2 if self.need_geom or self.need_full else 1)
        if (
            self.numbers.any
            and not self.poll_only
            and now_s - self._acked_s >= asking_period_s - NOTHING_S
        ):
            self.acknowledge(now_s)
        if self._may_ask:
            for body in self.tiles.questions(now_s):
                self._send(now_s, ASK, body)
        frames = list(self._outbox)
        self._outbox.clear()
        return frames

    def _has_to_greet(self, now_s: float) -> bool:
        """Nobody is known, or whoever sends does not know us: it may have started again."""
        stranger = self.auth_failed or self._hello_wanted or self.tiles.is_unheard(now_s)
        return self.geom is None or stranger

    def note(self, now_s: float, frame: Frame) -> None:
        """One more frame for the next ACK."""
        self._unacked += 1
        if self._unacked >= self.ack_every > 0 and not self.poll_only:
            self.acknowledge(now_s)
        if frame.type == MAP and self.poll_only:  # a sender that has started since pushes again
            self._hello_wanted = True

    # What may be asked for; all of it goes out with the next poll

    def greet(self) -> None:
        """Say HELLO once more: to a sender that has just been met."""
        self._hello_wanted, self._hello_due_s = True, -math.inf

    def acknowledge(self, now_s: float) -> None:
        """One ACK as of now, besides those that come by themselves; none before the first frame."""
        if self.numbers.any and self.ack_every:
            self._acked_s, self._unacked = now_s, 0
            self._send(now_s, ACK, self.ack(now_s))

    def ask(
        self, now_s: float, *, geometry: bool = False, pose: bool = False, stop_zone: bool = False
    ) -> bool:
        """Ask for what comes with the next tick; False while nobody would listen (see `drive`)."""
        what = asking.ASK_GEOM * geometry | asking.ASK_POSE * pose | asking.ASK_ZONE * stop_zone
        if not what or not self._may_ask:
            return False
        self._asks += 1
        self._send(now_s, ASK, asking.ask_body(self._asks, what))
        return True

    def ask_tile(
        self, layer: str, i: int, j: int, width: int, height: int, *, in_window: bool = False
    ) -> Tile:
        """A rectangle of the sender's map; it fills as `poll` asks and frames are fed.

        Args:
            layer: "class", "height", "variance" or "slope".
            i, j: lowest column and row; of the endless grid (as `origin`), or of the window.
            width, height: cells along map x and y, together at most 160 801.

        Raises:
            ValueError: no such layer, no cells, or too many.
        """
        return self.tiles.ask(layer, (i, j), (height, width), in_window)

    def drive(self, now_s: float, v_mps: float, w_radps: float, valid_s: float) -> bool:
        """Ask the robot to move, forward and counter-clockwise, for up to 1 s; 0 s: stop now.

        To be repeated at least three times within `valid_s`. False, and nothing is sent, while the
        run of the sender is not known or there is no return path.

        Raises:
            ValueError: a speed or a time that the frame cannot tell.
        """
        if self.geom is None or not self.ack_every:
            return False
        body = asking.drive_body(self.geom.session, self.nonce, v_mps, w_radps, valid_s)
        self._send(now_s, DRIVE, body)
        return True

    def external_pose(
        self,
        now_s: float,
        x_m: float,
        y_m: float,
        yaw_rad: float | None,
        *,
        sigma_x_m: float,
        sigma_y_m: float,
        sigma_yaw_rad: float = 0.0,
        correlation: float = 0.0,
        age_s: float = 0.0,
    ) -> bool:
        """Tell where a positioning system saw the robot; see `asking.external_body`. As `drive`.

        Raises:
            ValueError: a number that the frame cannot tell.
        """
        if self.geom is None or not self.ack_every:
            return False
        body = asking.external_body(
            self.geom.session, self.nonce, x_m, y_m, yaw_rad, sigma_x_m=sigma_x_m,
            sigma_y_m=sigma_y_m, sigma_yaw_rad=sigma_yaw_rad, correlation=correlation, age_s=age_s,
        )  # fmt: skip
        self._send(now_s, EXTERNAL_POSE, body)
        return True

    def ack(self, now_s: float) -> bytes:
        """The body of an ACK as of now."""
        bits = (
            self.need_geom or self.geom is None,
            self.need_full,
            self.stale(now_s),
            self.suspect,
            self.stopped,
            self.digest_ok,
            self.auth_failed,
        )
        return asking.ack_body(
            self.numbers.last,
            self.numbers.mask,
            self.numbers.t_ms,
            now_s - self.numbers.counted_s,
            self.rejected.total(),
            sum(bit << i for i, bit in enumerate(bits)),
            self.geom.geom_id if self.geom else 0,
        )

    @property
    def _may_ask(self) -> bool:
        """There is a way back; and with a key, a session to sign for."""
        return bool(self.ack_every) and (self._key is None or self.geom is not None)

    def _send(self, now_s: float, frame_type: int, body: bytes) -> None:
        self._sent += 1
        t_ms = math.floor(now_s * 1000 + 1e-6)
        if self._key is None or self.geom is None:
            frame = bytes_from_frame(frame_type, self._sent, t_ms, body)
        else:
            session = self.geom.session
            frame = signed_bytes_from_frame(
                frame_type, self._sent, t_ms, body, self._key, session, self.nonce
            )
        self._outbox.append(frame)
