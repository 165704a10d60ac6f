"""What the fake Kinect sees against what is true, each of its gaps by itself, and its dumps."""

from pathlib import Path

import numpy as np
import pytest

from fakes.kinect.dump import write_dump
from fakes.kinect.faults import Faults
from fakes.kinect.sensing import NO_RAW, RIM_COLUMNS, Lens, Sensor, raw_of_depths
from fakes.programs import kinect_dump
from fakes.rays.kernels import BLACK, PLAIN
from fakes.rays.sight import Met
from fakes.wires.timing import F64
from fakes.world.rotations import rotation_z
from tests import Capsys

LENS = Lens((64, 48), (58.0, 58.0), (31.5, 23.5))


class Panel:
    """A panel, left or right of the camera's middle, before a wall."""

    def __init__(self, near_m: float, far_m: float, is_left: bool = True) -> None:
        self.near_m, self.far_m, self.is_left, self.material = near_m, far_m, is_left, PLAIN

    def met(self, t_s: float, begins: F64, ways: F64) -> Met:
        y = begins[:, 1] + (self.near_m - begins[:, 0]) / ways[:, 0] * ways[:, 1]
        is_near = y > 0 if self.is_left else y < 0
        ahead_m = np.where(is_near, self.near_m, self.far_m) - begins[:, 0]
        normals = np.broadcast_to(np.array([-1.0, 0.0, 0.0]), ways.shape)
        materials = np.where(is_near, self.material, PLAIN)
        ranges_m = ahead_m / ways[:, 0]
        points = begins + ranges_m[:, None] * ways
        return Met(ways, ranges_m, points, normals, is_near.astype(np.int64), materials)


def sensor(panel: Panel, noise: float = 0.0) -> Sensor:
    faults = Faults()
    faults.tilt_deg, faults.mount_m, faults.noise = 0.0, (0.0, 0.0, 0.5), noise
    return Sensor(faults, LENS, panel.met, 1)


def test_raw_values_are_those_of_the_sheet() -> None:
    told = {0.705: 600, 0.768: 640, 0.887: 700, 1.193: 800, 1.824: 900, 3.864: 1000, 8.767: 1050}
    raws = raw_of_depths(np.array(list(told)) + 0.0005)
    np.testing.assert_allclose(raws, list(told.values()), atol=0.4)


def test_what_the_projector_does_not_reach_is_missing_left_of_a_near_thing() -> None:
    right = sensor(Panel(0.7, 2.0, is_left=False)).picture(0.0)
    missing = right.raw[24] == NO_RAW
    shadow_px = 58.0 * 0.075 * (1 / 0.7 - 1 / 2.0)
    assert abs(missing[:32].sum() - shadow_px) <= 1.5
    assert missing[32 - int(shadow_px) : 32].any()
    assert not missing[32:-RIM_COLUMNS].any()
    assert missing[-RIM_COLUMNS:].all()
    left = sensor(Panel(0.7, 2.0, is_left=True)).picture(0.0)
    assert (left.raw[24] == NO_RAW).sum() == RIM_COLUMNS
    assert set(left.raw[24, :31]) == {round(float(raw_of_depths(np.array([0.7]))[0]))}


def test_what_is_too_near_or_black_and_far_is_missing() -> None:
    near = sensor(Panel(0.35, 2.0)).picture(0.0)
    assert (near.raw[:, :31] == NO_RAW).all()
    panel = Panel(2.5, 3.0)
    assert (sensor(panel).picture(0.0).raw[:, :31] != NO_RAW).all()
    panel.material = BLACK
    assert (sensor(panel).picture(0.0).raw[:, :31] == NO_RAW).all()


def test_how_the_machine_is_turned_in_the_map_does_not_matter() -> None:
    panel, R = Panel(1.0, 2.0), rotation_z(1.5)
    one = sensor(panel).picture(0.0).raw
    unturned = panel.met

    def turned(t_s: float, begins: F64, ways: F64) -> Met:
        met = unturned(t_s, begins, ways)
        return met._replace(ways=met.ways @ R.T, normals=met.normals @ R.T)

    panel.met = turned  # type: ignore[method-assign]
    np.testing.assert_array_equal(sensor(panel).picture(0.0).raw, one)
    assert (one != NO_RAW).mean() > 0.8


def test_noise_is_a_part_of_a_step_and_repeats_by_its_seed() -> None:
    one, other = (sensor(Panel(1.5, 1.5), 1.0).picture(0.0).raw for _ in range(2))
    np.testing.assert_array_equal(one, other)
    spread = one[:, :-RIM_COLUMNS].astype(float).std()
    assert 0.2 < spread < 0.6


def test_a_dump_is_laid_out_as_the_recorder_does(tmp_path: Path, capsys: Capsys) -> None:
    raw = np.zeros((480, 640), np.uint16)
    raw[0, 1] = 0x0201
    write_dump(tmp_path / "dump", [(0.0, raw), (0.5, raw)])
    names = ["d-1290000000.000000-0.pgm", "d-1290000000.500000-30000000.pgm"]
    assert (tmp_path / "dump" / "INDEX.txt").read_text().split() == names
    data = (tmp_path / "dump" / names[0]).read_bytes()
    assert len(data) == 614_417
    assert data[:21] == b"P5 640 480 65535\n\0\0\x01\x02"
    with pytest.raises(ValueError, match="480 rows and 640 columns"):
        write_dump(tmp_path / "small", [(0.0, raw[::2])])
    assert kinect_dump.main(["--frames", "1", str(tmp_path / "program")]) == 0
    assert len(list((tmp_path / "program").iterdir())) == 2
    assert kinect_dump.main([str(tmp_path / "program")]) == 2
    assert kinect_dump.main(["--scene", "wall:x", str(tmp_path / "none")]) == 2
    assert "no scene 'wall:x'" in capsys.readouterr().err
