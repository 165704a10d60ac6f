"""The public receiver against a slow and obvious one: both are fed the same frames, in any order.

Source: planner link, sections 4 and 5, and 14, items 2 and 5.
"""

import struct

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from mapod_link.frames import DIGEST, GEOM, MAP, POSE, STOP_ZONE, bytes_from_frame
from mapod_link.receiver import Receiver
from tests.support.cases import examples
from tests.support.link.planner_sender import NONCE, geom_body, map_body, op, pose_body, zone_body
from tools.conformance.slow_receiver import SlowReceiver

RUNS = st.lists(st.tuples(st.integers(0, 3), st.integers(1, 70)), max_size=6)
SIZES = st.sampled_from([(9, 5), (5, 9), (3, 3), (12, 7)])


class TwoReceivers(RuleBasedStateMachine):
    """A sender's frames, kept, repeated, swapped, damaged and lost."""

    def __init__(self) -> None:
        super().__init__()
        self.fast, self.slow = Receiver(NONCE), SlowReceiver(NONCE)
        self.now_s, self.seq = 1.0, 0xFFF0
        self.ox, self.oy, self.geom_id, self.session = 32_760, -3, 7, 1
        self.size, self.late = (9, 5), list[bytes]()

    def made(self, kind: int, body: bytes) -> bytes:
        self.seq += 1
        return bytes_from_frame(kind, self.seq, round(self.now_s * 1000), body)

    def arrives(self, frame: bytes) -> None:
        self.fast.feed_datagram(self.now_s, frame)
        self.slow.feed_datagram(self.now_s, frame)

    @rule(
        size=SIZES, restarts=st.booleans(), fate=st.sampled_from(["arrives", "lost", "told again"])
    )
    def geometry(self, size: tuple[int, int], restarts: bool, fate: str) -> None:
        """A new epoch, perhaps of a new run; or the same again, as once a second."""
        if fate != "told again":
            self.size, self.geom_id = size, (self.geom_id + 1) % 256
            if restarts:
                self.session, self.seq = self.session + 1, 5
        frame = self.made(GEOM, geom_body(self.geom_id, *self.size, self.session))
        if fate != "lost":
            self.arrives(frame)

    @rule(
        runs=RUNS,
        start=st.integers(0, 84),
        move=st.tuples(st.integers(-6, 6), st.integers(-6, 6)),
        lag=st.integers(0, 5),
        fate=st.sampled_from(["arrives", "arrives", "arrives", "lost", "late", "twice", "cut"]),
    )
    def cells(
        self, runs: list[tuple[int, int]], start: int, move: tuple[int, int], lag: int, fate: str
    ) -> None:
        """A MAP frame; some of them pass the last cell."""
        self.ox, self.oy = self.ox + move[0], self.oy + move[1]
        ops = b"".join(op(*run) for run in runs)
        ops = ops[:-1] + b"\xbf" if fate == "cut" else ops
        body = map_body(ops, start, self.ox, self.oy, self.seq + 1 - lag, self.geom_id)
        frame = self.made(MAP, body)
        if fate == "late":
            self.late.append(frame)
        for _ in range({"late": 0, "lost": 0, "twice": 2}.get(fate, 1)):
            self.arrives(frame)

    @rule(kind=st.sampled_from([POSE, STOP_ZONE, 13, 8, 9, 10, 11, 12]))
    def others(self, kind: int) -> None:
        bodies = {POSE: pose_body(), STOP_ZONE: zone_body()}
        self.arrives(self.made(kind, bodies.get(kind, b"new")))

    @rule(right=st.booleans(), own=st.booleans())
    def digest(self, right: bool, own: bool) -> None:
        crc = self.fast.digest() ^ (not right)
        self.arrives(self.made(DIGEST, struct.pack("<BxxxI", self.geom_id if own else 99, crc)))

    @rule()
    def what_was_late(self) -> None:
        while self.late:
            self.arrives(self.late.pop())

    @rule(at=st.integers(0, 200), change=st.integers(1, 255))
    def damaged(self, at: int, change: int) -> None:
        frame = bytearray(self.made(MAP, map_body(op(1, 9), geom_id=self.geom_id)))
        frame[at % len(frame)] ^= change
        self.arrives(bytes(frame))

    @rule(seconds=st.sampled_from([0.02, 0.02, 0.1, 0.2, 59.0, 62.0]))
    def time_passes(self, seconds: float) -> None:
        """Also more than the minute after which numbers say nothing."""
        self.now_s += seconds

    @rule(count=st.sampled_from([30, 40_000, 65_535]))
    def many_are_lost(self, count: int) -> None:
        """Numbers may wrap unseen."""
        self.seq += count

    @invariant()
    def they_agree(self) -> None:
        fast, slow = self.fast, self.slow
        assert fast.cells.tolist() == slow.window().tolist()
        assert (fast.suspect, fast.blank) == (slow.suspect, slow.blank)
        if fast.origin is not None and slow.origin is not None:
            pairs = zip(fast.origin, slow.origin, strict=True)
            assert all((a - b) % 2**16 == 0 for a, b in pairs)
        if slow.last is not None:
            assert (fast.numbers.last, fast.numbers.mask) == (slow.last, slow.mask)
        assert fast.stale(self.now_s) == slow.stale(self.now_s)
        assert (fast.needs.geom, fast.needs.full) == (slow.need_geom, slow.need_full)
        assert fast.needs.digest_ok == slow.digest_ok


TestTwoReceivers = TwoReceivers.TestCase
TestTwoReceivers.settings = settings(max_examples=examples(12), stateful_step_count=40)
