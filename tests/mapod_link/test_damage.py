"""Damage, junk and lies: no bytes make the public receiver raise, or change it by half.

Source: planner link, section 14, items 3 and 4.
"""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from mapod_link.frames import GEOM, MAP, POSE, bytes_from_frame
from mapod_link.receiver import Receiver
from tests.support.planner_sender import NONCE, VECTORS, receiving, signed_frame, state_of, vector


@given(st.lists(st.binary(max_size=400), max_size=8))
def test_no_bytes_make_the_planner_raise(pieces: list[bytes]) -> None:
    planner = Receiver(NONCE)
    before = state_of(planner)
    for now_s, piece in enumerate(pieces):
        planner.feed_datagram(float(now_s), piece)
        planner.exchange(float(now_s), piece)
    assert state_of(planner) == before


@given(st.integers(0, 15), st.integers(0, 255), st.binary(max_size=356), st.booleans())
def test_a_frame_with_an_arbitrary_body_acts_whole_or_not_at_all(
    kind: int, flags: int, body: bytes, right_geometry: bool
) -> None:
    planner = receiving().planner
    if right_geometry and kind == MAP:
        body = body[:6] + b"\x07" + body[7:]
    before, accepted = state_of(planner), planner.accepted.total()
    planner.feed_datagram(1.0, bytes_from_frame(kind, 9, 1, body, flags))
    if planner.accepted.total() == accepted:
        assert state_of(planner) == before
    planner.poll(1.0)


@given(st.lists(st.integers(0, 120)), st.lists(st.sampled_from([b"", b"\0", b"\0\0"]), min_size=4))
def test_where_the_stream_is_cut_makes_no_difference(cuts: list[int], idle: list[bytes]) -> None:
    names = ("geom_serial", "pose_serial", "map_serial")
    stream = b"".join(gap + vector(name) for gap, name in zip(idle, names, strict=False))
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    planner = Receiver(NONCE)
    for a, b in pairwise(edges):
        planner.feed_stream(0.0, stream[a:b])
    assert planner.digest() == int(VECTORS["digest_crc"], 16)
    assert planner.accepted == {GEOM: 1, POSE: 1, MAP: 1}
    assert not planner.rejected


def test_a_frame_that_never_ends_is_one_rejection_and_holds_no_memory() -> None:
    planner = Receiver(NONCE)
    for _ in range(100):
        planner.feed_stream(0.0, b"\x01" * 1000)
    planner.feed_stream(0.0, b"\0" + vector("geom_serial"))
    assert planner.rejected == {"cobs": 1}
    assert planner.geom is not None


@given(st.lists(st.binary(max_size=400), max_size=8), st.booleans())
def test_a_receiver_with_a_key_stays_as_it_is_whatever_strangers_send(
    pieces: list[bytes], whole: bool
) -> None:
    key = bytes(range(32))
    receiver = Receiver(NONCE, key=key)
    geom = vector("geom")[8:-4]
    receiver.feed_datagram(0.0, signed_frame(key, NONCE, GEOM, 1, 1000, geom))
    before = state_of(receiver)
    for k, piece in enumerate(pieces):
        frame = bytes_from_frame(k % 7, 2 + k, 1000 + k, piece[:348], 0x10 * (k % 2), piece[:8])
        receiver.feed_datagram(1.0, frame if whole else piece)
    assert state_of(receiver) == before
