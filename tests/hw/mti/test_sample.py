"""Orientations of an MTi: two notations, three earth frames, and what is no rotation."""

import math
import struct

import numpy as np
import numpy.typing as npt
from hypothesis import given
from hypothesis import strategies as st

from hw.mti.mtdata import MtDataDecoder
from hw.mti.mtdata2 import decode_mtdata2
from hw.mti.sample import (
    ENU,
    NED,
    NWU,
    MtSample,
    maybe_from_euler_deg,
    maybe_orientation,
    maybe_unit,
)

ANGLES = st.tuples(st.floats(-180, 180), st.floats(-89, 89), st.floats(-180, 180))


def rotation(roll: float, pitch: float, yaw: float) -> npt.NDArray[np.float64]:
    """Rz(yaw) Ry(pitch) Rx(roll) from degrees, written out."""
    (a, b, c) = np.radians([roll, pitch, yaw])
    rx = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    ry = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    rz = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    return np.asarray(rz @ ry @ rx)


def matrix(q: tuple[float, float, float, float] | None) -> npt.NDArray[np.float64]:
    """The rotation of a quaternion."""
    assert q is not None
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


TO_NWU = {  # rows: where the axes of the frame point, in north, west, up
    ENU: np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    NED: np.diag([1.0, -1.0, -1.0]),
    NWU: np.eye(3),
}


@given(ANGLES, st.sampled_from([ENU, NED, NWU]))
def test_every_earth_frame_becomes_north_west_up(
    angles: tuple[float, float, float], frame: int
) -> None:
    expected = TO_NWU[frame] @ rotation(*angles)
    if frame != ENU:  # which no legacy device has
        settings = 0x304 | (0x8000_0000 if frame == NED else 0)
        legacy = MtDataDecoder(0x0004, settings).decode(struct.pack(">3d", *angles))
        assert isinstance(legacy, MtSample)
        np.testing.assert_allclose(matrix(legacy.q_earth_sensor), expected, atol=1e-12)
    for packet, data in (
        (0x2033, struct.pack(">3d", *angles)),
        (0x2013, struct.pack(">4d", *(maybe_from_euler_deg(*angles) or ()))),
    ):
        message = struct.pack(">HB", packet | frame << 2, len(data)) + data
        sample = decode_mtdata2(message)
        assert isinstance(sample, MtSample)
        np.testing.assert_allclose(matrix(sample.q_earth_sensor), expected, atol=1e-12)


def test_what_is_no_rotation_is_refused() -> None:
    nan, inf = math.nan, math.inf
    assert maybe_orientation(1, (0.0, 0.0, 0.0), 3) is None  # no such earth frame
    assert maybe_unit(1.0, 0.1, 0.3, 0.0) is None
    assert maybe_unit(nan, 0.0, 0.0, 0.0) is None
    assert maybe_unit(inf, 0.0, 0.0, 0.0) is None
    assert maybe_from_euler_deg(nan, 0.0, 0.0) is None
    assert maybe_from_euler_deg(0.0, 91.0, 0.0) is None
