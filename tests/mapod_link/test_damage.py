"""Junk and cut streams: no bytes make the public receiver raise, or change it.

Source: planner link, section 14, items 3 and 4.
"""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from mapod_link.frames import GEOM, MAP, POSE
from mapod_link.receiver import Receiver
from tests.support.planner_sender import NONCE, VECTORS, state_of, vector


@given(st.lists(st.binary(max_size=400), max_size=8))
def test_no_bytes_make_the_planner_raise(pieces: list[bytes]) -> None:
    planner = Receiver(NONCE)
    before = state_of(planner)
    for now_s, piece in enumerate(pieces):
        planner.feed_datagram(float(now_s), piece)
        planner.exchange(float(now_s), piece)
    assert state_of(planner) == before


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
