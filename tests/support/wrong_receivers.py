"""Receivers of the planner link that are wrong in one way each: the conformance tests find them."""

from collections.abc import Callable
from typing import Any

from tools.conformance.slow_receiver import Run, SlowReceiver
from tools.conformance.wire import (
    KEEP,
    MAP,
    U8,
    UNKNOWN,
    Geom,
    cobs,
    frame,
    int16,
    sealed,
)

Method = Callable[..., Any]


def wrong(**methods: Any) -> type[SlowReceiver]:
    """A receiver of which some rules are others."""
    return type("Wrong", (SlowReceiver,), methods)


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
    split = [
        part
        for s, a, b in runs
        for part in (
            [(KEEP, a, a + 200), (UNKNOWN, a + 200, b)]
            if s == KEEP and b - a > 200
            else [(s, a, b)]
        )
    ]
    SlowReceiver.apply(self, split)


def _only_new_cells(self: SlowReceiver, runs: list[Run]) -> None:
    """Takes operations for differences: what is there stays."""
    before = dict(self.cells)
    SlowReceiver.apply(self, runs)
    self.cells.update(before)


def _no_gap(self: SlowReceiver, now_s: float, seq: int, t_ms: int, begins: bool) -> None:
    SlowReceiver.count(self, now_s, seq, t_ms, begins)
    self.gap = None


def _first_gap_stays(self: SlowReceiver, now_s: float, seq: int, t_ms: int, begins: bool) -> None:
    """A second gap does not move the first."""
    gap = self.gap
    SlowReceiver.count(self, now_s, seq, t_ms, begins)
    self.gap = self.gap if gap is None or begins else gap


def _counts_back(self: SlowReceiver, now_s: float, seq: int, t_ms: int, begins: bool) -> None:
    """The newest is what came last, whatever its number."""
    if self.last is not None and int16(seq - self.last) <= 0:
        begins = True
    SlowReceiver.count(self, now_s, seq, t_ms, begins)


def _mask_from_newest(self: SlowReceiver, now_s: float, seq: int, t_ms: int, b: bool) -> None:
    """Bit 0 is the newest frame itself."""
    SlowReceiver.count(self, now_s, seq, t_ms, b)
    self.mask = (self.mask << 1 | 1) & 0xFFFFFFFF


def _mask_all(self: SlowReceiver, now_s: float, seq: int, t_ms: int, begins: bool) -> None:
    SlowReceiver.count(self, now_s, seq, t_ms, begins)
    self.mask = 0xFFFFFFFF


def _mask_stays(self: SlowReceiver, now_s: float, seq: int, t_ms: int, begins: bool) -> None:
    """The mask of the run before goes on."""
    mask, last = self.mask, self.last
    SlowReceiver.count(self, now_s, seq, t_ms, begins)
    if begins and last is not None:
        self.mask = (mask << 1 | 1) & 0xFFFFFFFF


def _swapped(self: SlowReceiver, body: bytes) -> Geom | None:
    """Rows for columns."""
    geom = SlowReceiver.maybe_geom(self, body)
    if geom is None:
        return None
    return Geom(
        geom.geom_id, geom.height, geom.width, geom.session, geom.stale_ms, geom.tick_ms,
        geom.cell_mm,
    )  # fmt: skip


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


def _no_tag(self: SlowReceiver, flags: int, content: bytes, *_: Any) -> bool:
    return True


def _any_session(self: SlowReceiver, *arguments: Any) -> bool:
    self.left.clear()
    return SlowReceiver.tag_is_right(self, *arguments)


def _never_ok(self: SlowReceiver, body: bytes) -> None:
    """Its own sum is another."""
    self.digest_ok, self.need_full = False, True


def _bad_padding(self: SlowReceiver, body: bytes) -> None:
    """Leaves the cells of the last byte out of the sum."""
    window: U8 = self.window()
    window.flat[window.size // 4 * 4 :] = 0
    kept = self.cells
    self.cells = {}
    assert self.origin is not None
    for row, column in zip(*window.nonzero(), strict=True):
        place = self.origin[0] + int(column), self.origin[1] + int(row)
        self.cells[place] = int(window[row, column])
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
    body = self.nonce.to_bytes(4, "little") + bytes.fromhex("0010000070010000")
    return [*SlowReceiver.poll(self, now_s), frame(9, 1, 0, body)]


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
    "suspect is never set": ("5", wrong(count=_no_gap)),
    "second gap is forgotten": ("5", wrong(count=_first_gap_stays)),
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
    "mask from the newest": ("5", wrong(count=_mask_from_newest)),
    "mask of ones": ("5", wrong(count=_mask_all)),
    "mask of another run": ("5", wrong(count=_mask_stays)),
    "older frames are taken": ("5", wrong(is_newer=lambda s, q, t: True, count=_counts_back)),
    "repeated frames are taken": (
        "5",
        wrong(
            is_newer=lambda s, q, t: s.last is None or int16(q - s.last) >= 0, count=_counts_back
        ),
    ),
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
    "tags are not looked at": wrong(tag_is_right=_no_tag),
    "t_ms may go back": wrong(is_newer=lambda s, q, t: s.last is None or int16(q - s.last) > 0),
    "sessions may come back": wrong(tag_is_right=_any_session),
}
