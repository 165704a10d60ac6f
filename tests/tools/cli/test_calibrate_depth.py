"""`mapod calibrate depth`: over frames of the fake Kinect and real ones, and what it refuses."""

import gzip
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from config_file import load_config
from fakes.kinect.device import FakeKinect, camera_toml, mm_of_raw, png_of
from fakes.kinect.sensing import Lens
from fakes.world.simple import Ground
from hw.depth_images.session import DepthImages
from tests import ROOT, VECTORS, Capsys
from tests.support.devices.bench_kinect import Bench
from tools.calibration.collect_depth import Watch
from tools.calibration.collect_floor import READY_S, RefusedError
from tools.cli import calibrate

pytest.importorskip("shapely", reason="needs shapely: pip install 'mapod[objects]'")
SHIPPED = (ROOT / "mapod.toml").read_text(encoding="utf-8")
LENS = Lens((320, 240), (290.0, 290.0), (159.5, 119.5))
TRUE_Z_M, TRUE_DEG = 0.62, 27.0


def folder_of(folder: Path, images: list[Any], lens: Lens) -> Path:
    folder.mkdir()
    for k, numbers in enumerate(images):
        (folder / f"{k}.png").write_bytes(png_of(numbers))
    lines = "".join(f"{k}.png,{k / 30}\n" for k in range(len(images)))
    (folder / "times.csv").write_text(lines)
    (folder / "camera.toml").write_bytes(camera_toml(lens, 1.0))
    return folder


def frames(folder: Path, scene: str = "floor", count: int = 5, tilt_deg: float = TRUE_DEG) -> Path:
    fake = FakeKinect(Ground(scene).met, 1, "png", LENS)
    fake.tilt_deg, fake.mount_m = tilt_deg, (0.35, 0.0, TRUE_Z_M)
    images = [mm_of_raw(fake.sensor.picture(k / 30).raw) for k in range(count)]
    return folder_of(folder, images, LENS)


def called(tmp_path: Path, folder: Path, *more: str, **mount: float) -> int:
    text = SHIPPED
    for key, value in mount.items():
        before = getattr(load_config(SHIPPED).depth, key)
        text = text.replace(f"{key} = {before:.2f}", f"{key} = {value}", 1)
        text = text.replace(f"{key} = {before:.1f} ", f"{key} = {value} ", 2)
    (tmp_path / "mapod.toml").write_text(text)
    given = ["depth", "--folder", str(folder), "--config", str(tmp_path / "mapod.toml"), *more]
    return calibrate.main(given)


def depth_in(tmp_path: Path) -> Any:
    return load_config((tmp_path / "mapod.toml").read_text()).depth


@pytest.mark.parametrize("scene", ["floor", "wall:1.6"])
def test_the_mount_is_found_from_a_rough_guess_and_written(
    tmp_path: Path, capsys: Capsys, scene: str
) -> None:
    assert called(tmp_path, frames(tmp_path / "frames", scene), "--write") == 0
    told = capsys.readouterr()
    assert told.err == ""
    assert "in 5 of 5 frames" in told.out
    depth = depth_in(tmp_path)
    errors = [float(line.split()[-1]) for line in told.out.splitlines() if "+-" in line]
    assert abs(depth.mount_z_m - TRUE_Z_M) < 2 * errors[0] < 0.02
    assert abs(depth.mount_roll_deg) < 2 * errors[1] < 1.0
    assert abs(depth.mount_tilt_deg - TRUE_DEG) < 2 * errors[2] < 1.0
    assert (depth.mount_x_m, depth.mount_yaw_deg) == (0.35, 0.0)


@pytest.mark.parametrize(
    ("files", "guess", "true"),
    [
        (["boxes_1", "boxes_2"], (0.6, 42.0), (0.7132, 45.8, -5.9)),
        (["five_people"], (1.2, 9.0), (1.2937, 4.9, -0.3)),
    ],
)
def test_real_frames_give_what_other_programs_find(
    tmp_path: Path, files: list[str], guess: tuple[float, float], true: tuple[float, float, float]
) -> None:
    lens = Lens((640, 480), (525.0, 525.0), (320.0, 240.0))
    packed = [
        gzip.decompress((VECTORS / "kinect" / f"{name}.u16.gz").read_bytes()) for name in files
    ]
    images = [np.frombuffer(data, "<u2").reshape(480, 640) for data in packed]
    folder = folder_of(tmp_path / "frames", images, lens)
    assert called(tmp_path, folder, "--write", mount_z_m=guess[0], mount_tilt_deg=guess[1]) == 0
    depth = depth_in(tmp_path)
    assert abs(depth.mount_z_m - true[0]) < 0.01
    assert abs(depth.mount_tilt_deg - true[1]) < 1.0
    assert abs(depth.mount_roll_deg - true[2]) < 1.0


def test_what_the_floor_does_not_tell_is_refused_and_nothing_written(
    tmp_path: Path, capsys: Capsys
) -> None:
    def refused(status: int, why: str, folder: Path, **mount: float) -> None:
        assert called(tmp_path, folder, "--write", **mount) == status
        assert why in capsys.readouterr().err
        assert depth_in(tmp_path).mount_y_m == 0.0

    no_floor = "0 of 3 frames show a flat floor within 0.45 m and 18 deg of the settings' mount"
    refused(1, no_floor, frames(tmp_path / "up", "wall:1.2", 3, -30.0))
    refused(1, no_floor, frames(tmp_path / "far", count=3), mount_tilt_deg=70.0)
    none = frames(tmp_path / "none", count=1)
    (none / "camera.toml").unlink()
    refused(2, "has no camera.toml, which tells the lens", none)
    wrong = frames(tmp_path / "wrong", count=1)
    (wrong / "camera.toml").write_bytes(camera_toml(LENS, 10.0))
    refused(2, "camera.toml has a camera matrix that can't be: fx 2900", wrong)
    (wrong / "times.csv").unlink()
    (wrong / "camera.toml").write_bytes(camera_toml(LENS, 1.0))
    refused(2, "times.csv", wrong)
    moved = frames(tmp_path / "moved", count=2)
    for k, tilt_deg in enumerate((25.0, 29.0, 33.0)):
        other = frames(tmp_path / f"moved_{k}", count=1, tilt_deg=tilt_deg)
        (moved / f"{k}.png").write_bytes((other / "0.png").read_bytes())
    (moved / "times.csv").write_text("0.png,0\n1.png,1\n2.png,2\n")
    refused(1, "only 1 of 3 frames agree", moved, mount_tilt_deg=29.0)
    assert called(tmp_path, moved) == 1


def test_images_that_are_of_no_use_are_named_and_left_out(tmp_path: Path, capsys: Capsys) -> None:
    folder = frames(tmp_path / "frames")
    (folder / "1.png").write_bytes((folder / "1.png").read_bytes()[:-9])
    assert called(tmp_path, folder) == 0
    told = capsys.readouterr()
    assert told.err == "mapod calibrate depth: left out: image 2: a PNG without its end\n"
    assert "in 4 of 4 frames" in told.out


def run(bench: Bench, watch: Watch, seconds: float) -> bool:
    until_s = bench.now_s + seconds
    while bench.now_s < until_s:
        bench.wire.step(bench.now_s)
        if watch.step(bench.now_s):
            return True
        bench.now_s += 0.004
    return False


def test_a_live_camera_is_watched_for_so_long_or_its_cause_is_told() -> None:
    bench = Bench()
    assert isinstance(bench.camera, DepthImages)
    watch = Watch(bench.camera, 2.0)
    assert run(bench, watch, 3.0)
    assert 50 < len(watch.images) <= 61
    assert math.isclose(watch.images[-1].t_s - watch.images[0].t_s, 2.0, abs_tol=0.1)
    bench = Bench()
    bench.fake.all_invalid = True
    with pytest.raises(RefusedError, match="no image within 45 s: 0 images; the camera is running"):
        run(bench, Watch(bench.camera, 2.0), READY_S + 1.0)


def test_without_a_camera_or_its_sections_it_says_so(tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "mapod.toml"
    path.write_text(SHIPPED)
    assert calibrate.main(["depth", "--config", str(path)]) == 1
    assert "no camera is set; set one, or give --folder" in capsys.readouterr().err
    path.write_text(SHIPPED[: SHIPPED.index("[depth]")] + SHIPPED[SHIPPED.index("[ahrs]") :])
    assert calibrate.main(["depth", "--config", str(path)]) == 2
    assert "needs the sections [depth] and [objects]" in capsys.readouterr().err
