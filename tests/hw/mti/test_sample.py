"""Orientations of an MTi: two notations, three earth frames, and what is no rotation."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.mti.mtdata import MtDataDecoder, decode_mtdata2
from hw.mti.sample import (
    ENU,
    EULER,
    NED,
    NWU,
    MtSample,
    maybe_from_euler_deg,
    maybe_orientation,
    maybe_unit,
)
from tests.support.bench_mti import rotated, turned
from tests.support.cases import examples

TO_NWU = {  # rows: where the axes of the frame point, in north, west, up
    ENU: np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    NED: np.diag([1.0, -1.0, -1.0]),
    NWU: np.eye(3),
}


@pytest.mark.parametrize("frame", TO_NWU)
@settings(max_examples=examples(20))
@given(st.tuples(st.floats(-180, 180), st.floats(-89, 89), st.floats(-180, 180)))
def test_every_earth_frame_becomes_north_west_up(
    frame: int, angles: tuple[float, float, float]
) -> None:
    samples = []
    if frame != ENU:  # which no legacy device has
        word = 0x304 | (0x8000_0000 if frame == NED else 0)
        samples.append(MtDataDecoder(0x0004, word).decode(struct.pack(">3d", *angles)))
    for packet, data in (
        (0x2033, struct.pack(">3d", *angles)),
        (0x2013, struct.pack(">4d", *(maybe_from_euler_deg(*angles) or ()))),
    ):
        head = struct.pack(">HB", packet | frame << 2, len(data))
        samples.append(decode_mtdata2(head + data))
    for sample in samples:
        assert isinstance(sample, MtSample)
        expected = TO_NWU[frame] @ turned(*angles)
        np.testing.assert_allclose(rotated(sample.q_earth_sensor or ()), expected, atol=1e-12)


def test_what_is_no_rotation_is_refused() -> None:
    assert maybe_orientation(EULER, (0.0, 0.0, 0.0), 3) is None  # no such earth frame
    assert maybe_unit(1.0, 0.1, 0.3, 0.0) is None
    assert maybe_unit(math.nan, 0.0, 0.0, 0.0) is None
    assert maybe_unit(math.inf, 0.0, 0.0, 0.0) is None
    assert maybe_from_euler_deg(math.nan, 0.0, 0.0) is None
    assert maybe_from_euler_deg(0.0, 91.0, 0.0) is None
