"""Receivers of the planner link that are wrong in one way each: the conformance tests find them."""

import copy
import dataclasses
import struct
from collections.abc import Callable
from typing import Any

from tools.conformance.slow_receiver import Run, SlowReceiver
from tools.conformance.wire import (
    KEEP,
    MAP,
    UNKNOWN,
    Geom,
    cobs,
    frame,
    int16,
    sealed,
)

ALL = 0xFFFFFFFF


def wrong(**methods: Any) -> type[SlowReceiver]:
    """A receiver of which some rules are others."""
    return type("Wrong", (SlowReceiver,), methods)


def counting(
    other: Callable[[SlowReceiver, SlowReceiver, bool], dict[str, Any]],
) -> type[SlowReceiver]:
    """A receiver whose books are others after each frame that counts.

    `other` is told it, as it was before, and whether a run of the sender begins.
    """

    def count(self: SlowReceiver, now_s: float, seq: int, t_ms: int, begins: bool) -> None:
        before = copy.copy(self)
        SlowReceiver.count(self, now_s, seq, t_ms, begins)
        for name, value in other(self, before, begins).items():
            setattr(self, name, value)

    return wrong(count=count)


def _half_applied(self: SlowReceiver, runs: list[Run]) -> None:
    """Operations are obeyed while they are checked."""
    if self.origin is not None:
        self.apply(runs)


def _keeps_what_leaves(self: SlowReceiver) -> None:
    """Cells that come back are what they were."""


def _unsigned_leb(self: SlowReceiver, body: bytes, at: int) -> tuple[int, int] | None:
    """One byte of a long number only."""
    return (body[at] & 0x7F, at + 1) if at < len(body) else None


def _endless_leb(self: SlowReceiver, body: bytes, at: int) -> tuple[int, int] | None:
    """As many bytes as it likes."""
    number, shift = 0, 0
    while at < len(body):
        number |= (body[at] & 0x7F) << shift
        shift, at = shift + 7, at + 1
        if body[at - 1] < 0x80:
            return number, at
    return None


def _cut_leb(self: SlowReceiver, body: bytes, at: int) -> tuple[int, int] | None:
    """A number that is cut off ends there."""
    return SlowReceiver.maybe_leb128(self, body + bytes(3), at)


def _long_keep_forgets(self: SlowReceiver, runs: list[Run]) -> None:
    """Of a KEEP of more than 200 cells, the rest becomes unknown."""
    rest = [(UNKNOWN, a + 200, b) for state, a, b in runs if state == KEEP and b - a > 200]
    SlowReceiver.apply(self, [*runs, *rest])


def _only_new_cells(self: SlowReceiver, runs: list[Run]) -> None:
    """Takes operations for differences: what is there stays."""
    before = dict(self.cells)
    SlowReceiver.apply(self, runs)
    self.cells.update(before)


def _counts_back(self: SlowReceiver, now_s: float, seq: int, t_ms: int, begins: bool) -> None:
    """The newest is what came last, whatever its number."""
    if self.last is not None and int16(seq - self.last) <= 0:
        begins = True
    SlowReceiver.count(self, now_s, seq, t_ms, begins)


def _swapped(self: SlowReceiver, body: bytes) -> Geom | None:
    """Rows for columns."""
    geom = SlowReceiver.maybe_geom(self, body)
    return geom and dataclasses.replace(geom, width=geom.height, height=geom.width)


def _fixed_stale(self: SlowReceiver, now_s: float) -> bool:
    """Does not look at `stale_ms`."""
    return self.geom is None or now_s - min(self.pose_s, self.map_s) > 0.15


def _any_frame_is_life(self: SlowReceiver, now_s: float) -> bool:
    return self.geom is None or now_s - self.newest_s > self.geom.stale_ms / 1000


def _foreign_is_life(self: SlowReceiver, now_s: float, data: bytes) -> None:
    """A MAP frame of any epoch, even a bad one, says that maps come."""
    SlowReceiver.feed_datagram(self, now_s, data)
    if self.is_whole(data) and data[0] & 15 == MAP:
        self.map_s = now_s


def _foreign_is_applied(self: SlowReceiver, now_s: float, data: bytes) -> None:
    """Does not look at `geom_id`."""
    if self.geom is not None and self.is_whole(data) and data[0] & 15 == MAP and len(data) >= 22:
        data = sealed(data[:14] + bytes([self.geom.geom_id]) + data[15:-4])
    SlowReceiver.feed_datagram(self, now_s, data)


def _ops_before_move(self: SlowReceiver, ox: int, oy: int) -> None:
    """The window never moves but at the first map."""
    if self.origin is None:
        SlowReceiver.move(self, ox, oy)


def _keeps_gap_on_jump(self: SlowReceiver, ox: int, oy: int) -> None:
    gap = self.gap
    SlowReceiver.move(self, ox, oy)
    self.gap = gap


def _slow_ack(self: SlowReceiver, now_s: float) -> None:
    """Tells of every frame as if it had come just now, and of another one."""
    self.newest_t_ms += 500
    SlowReceiver._acknowledge(self, now_s)


def _any_session(self: SlowReceiver, *arguments: Any) -> bool:
    self.left.clear()
    return SlowReceiver.tag_is_right(self, *arguments)


def _never_ok(self: SlowReceiver, body: bytes) -> None:
    """Its own sum is another."""
    self.digest_ok, self.need_full = False, True


def _bad_padding(self: SlowReceiver, body: bytes) -> None:
    """Leaves the cells of the last byte out of the sum."""
    assert self.origin is not None
    assert self.geom is not None
    (low_i, low_j), width, kept = self.origin, self.geom.width, self.cells
    end = width * self.geom.height // 4 * 4
    self.cells = {(i, j): s for (i, j), s in kept.items() if (j - low_j) * width + i - low_i < end}
    SlowReceiver.compare(self, body)
    self.cells = kept


def _short_end_refused(self: SlowReceiver, now_s: float, data: bytes) -> None:
    """Takes one of the two COBS forms of a full last run only."""
    for piece in self._splitter.feed(data):
        if piece is None or cobs(piece) == cobs(piece, short_end=True):
            self.feed_datagram(now_s, piece or b"")


def _one_type_too_few(self: SlowReceiver, now_s: float, data: bytes) -> None:
    """Frames of unknown types are refused."""
    if self.is_whole(data) and data[0] & 15 in (0, 7, 13, 14, 15):
        self.bad += 1
    else:
        SlowReceiver.feed_datagram(self, now_s, data)


def _hello_for_ever(self: SlowReceiver, now_s: float) -> list[bytes]:
    frames = SlowReceiver.poll(self, now_s)
    if now_s >= self._hello_s + 0.25:
        self._hello_s = now_s
        frames.append(frame(9, 1, 0, struct.pack("<IIHH", self.nonce, 4096, 368, 0)))
    return frames


# What is wrong: (the test that must find it, the receiver)
WRONG: dict[str, tuple[str, type[SlowReceiver]]] = {
    "CRC seed": ("1", wrong(seed=b"MPL2", has_right_crc=lambda s, d: False)),
    "no CRC": ("3", wrong(has_right_crc=lambda s, d: True)),
    "half a CRC": ("3", wrong(has_right_crc=lambda s, d: sealed(d[:-4])[:-2] == d[:-2])),
    "width and height": ("2", wrong(maybe_geom=_swapped)),
    "one COBS form": ("1", wrong(feed_stream=_short_end_refused)),
    "short frames only": ("1", wrong(max_frame=255)),
    "echo_t_ms": ("1", wrong(_acknowledge=_slow_ack)),
    "ACK once a second": ("1", wrong(ack_period_s=1.0)),
    "HELLO for ever": ("5", wrong(poll=_hello_for_ever)),
    "repaired is ignored": ("5", wrong(clears=lambda s, r, g: False)),
    "any map repairs": ("5", wrong(clears=lambda s, r, g: True)),
    "repaired one early": ("5", wrong(clears=lambda s, r, g: int16(r - g) >= -1)),
    "suspect is never set": ("5", counting(lambda *_: {"gap": None})),
    "second gap is forgotten": ("5", counting(
        lambda s, old, new: {} if old.gap is None or new else {"gap": old.gap})),
    "far move leaves suspect": ("5", wrong(move=_keeps_gap_on_jump)),
    "rejected frame half applied": ("4", wrong(rest_of_bad_runs=_half_applied)),
    "rejected frame taken": ("4", wrong(rest_of_bad_runs=lambda s, r: r)),
    "no UNKNOWN on scrolling": ("2", wrong(forget_outside=_keeps_what_leaves)),
    "window stands still": ("2", wrong(move=_ops_before_move)),
    "LEB128 off by one": ("2", wrong(long_run=lambda s, n: 63 + n)),
    "LEB128 of one byte": ("2", wrong(maybe_leb128=_unsigned_leb)),
    "LEB128 of any length": ("4", wrong(maybe_leb128=_endless_leb)),
    "LEB128 cut off": ("4", wrong(maybe_leb128=_cut_leb)),
    "a long KEEP forgets": ("2", wrong(apply=_long_keep_forgets)),
    "operations are differences": ("2", wrong(apply=_only_new_cells)),
    "mask from the newest": ("5", counting(lambda s, *_: {"mask": (s.mask << 1 | 1) & ALL})),
    "mask of ones": ("5", counting(lambda *_: {"mask": ALL})),
    "mask of another run": ("5", counting(
        lambda s, old, new: {"mask": (old.mask << 1 | 1) & ALL} if new and old.geom else {})),
    "older frames are taken": ("5", wrong(is_newer=lambda s, q, t: True, count=_counts_back)),
    "repeated frames are taken": ("5", wrong(
        is_newer=lambda s, q, t: s.last is None or int16(q - s.last) >= 0, count=_counts_back)),
    "unknown types are refused": ("4", wrong(feed_datagram=_one_type_too_few)),
    "any length": ("4", wrong(has_right_length=lambda s, k, b: k != MAP or len(b) >= 10)),
    "geom_id is ignored": ("5", wrong(feed_datagram=_foreign_is_applied)),
    "epoch keeps cells": ("5", wrong(is_other_epoch=lambda s, o, n: o is None)),
    "GEOM always erases": ("5", wrong(is_other_epoch=lambda s, o, n: True)),
    "session is ignored": ("5", wrong(
        is_other_epoch=lambda s, o, n: o is None or o.geom_id != n.geom_id)),
    "never stale": ("6", wrong(stale=lambda s, now_s: False)),
    "always stale": ("6", wrong(stale=lambda s, now_s: True)),
    "stale by any frame": ("6", wrong(stale=_any_frame_is_life)),
    "stale after 150 ms": ("6", wrong(stale=_fixed_stale)),
    "bad maps are life": ("6", wrong(feed_datagram=_foreign_is_life)),
    "DIGEST of another sum": ("2", wrong(compare=_never_ok)),
    "DIGEST without its last byte": ("2", wrong(compare=_bad_padding)),
}  # fmt: skip
WRONG_WITH_KEY: dict[str, type[SlowReceiver]] = {
    "tags are not looked at": wrong(tag_is_right=lambda *_: True),
    "t_ms may go back": wrong(is_newer=lambda s, q, t: s.last is None or int16(q - s.last) > 0),
    "sessions may come back": wrong(tag_is_right=_any_session),
}
