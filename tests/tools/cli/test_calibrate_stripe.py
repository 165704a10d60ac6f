"""`mapod calibrate stripe`: over pictures that the fake camera takes, and what it refuses."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from config_file import load_config
from fakes.stripe.device import FakeStripe
from fakes.stripe.jpeg import jpeg_from_image
from fakes.world.simple import Ground
from tests import ROOT, Capsys
from tools.calibration.stripe import Board, PicturesError, fit
from tools.cli import calibrate

pytest.importorskip("cv2", reason="needs OpenCV: pip install 'mapod[camera]'")
SHIPPED = (ROOT / "robots" / "ragno.toml").read_text(encoding="utf-8")
CAMERA_M, TRUE_M, TRUE_DEG = 0.2, 0.118, 11.4  # ahead of the body; of the laser
AT_M = (0.4, 0.55, 0.7, 0.9, 1.1)


def pictures(folder: Path, distances_m: Any = AT_M, **attributes: Any) -> Path:
    """Of boards, and their table."""
    lines = ["file,true_m"]
    for k, away_m in enumerate(distances_m):
        fake = FakeStripe(Ground(f"wall:{away_m + CAMERA_M:.4f}").met, k)
        fake.tilt_deg, fake.baseline_m, fake.laser_deg = 0.0, TRUE_M, TRUE_DEG
        for name, value in attributes.items():
            setattr(fake, name, value)
        (folder / f"{k}.jpg").write_bytes(jpeg_from_image(fake.camera.image(0.0), fake))
        lines.append(f"{k}.jpg,{away_m}")
    (folder / "board.csv").write_text("\n".join(lines) + "\n")
    return folder / "board.csv"


def called(folder: Path, table: Path, *more: str, text: str = SHIPPED) -> int:
    (folder / "mapod.toml").write_text(text)
    given = ["stripe", "--pictures", str(table), "--config", str(folder / "mapod.toml"), *more]
    return calibrate.main(given)


@pytest.mark.parametrize("distortion", [(0.0,) * 5, (-0.2, 0.05, 0.001, -0.001, 0.0)])
def test_the_lasers_plane_is_found_and_written(
    tmp_path: Path, capsys: Capsys, distortion: tuple[float, ...]
) -> None:
    none, some = [0.0] * 5, list(distortion)
    text = SHIPPED.replace(f"distortion = {none}", f"distortion = {some}")
    table = pictures(tmp_path, distortion=distortion)
    assert called(tmp_path, table, "--write", text=text) == 0
    told = capsys.readouterr()
    assert told.err == ""
    scanner: Any = load_config((tmp_path / "mapod.toml").read_text()).scanner.options
    assert abs(scanner.baseline_m - TRUE_M) < min(0.001, 3 * scanner.sigma_baseline_m)
    assert abs(scanner.laser_deg - TRUE_DEG) < min(0.1, 3 * scanner.sigma_laser_deg)
    assert scanner.sigma_baseline_m < 0.002
    corrected_mm = [abs(float(line.split()[-2])) for line in told.out.splitlines()[1:6]]
    assert max(corrected_mm) < 2.0


def test_the_covariance_is_that_of_many_draws() -> None:
    random, tangent = np.random.default_rng(1), math.tan(math.radians(TRUE_DEG))
    placed_m, error, found = 0.001, 1e-4, []
    for _ in range(800):
        boards = []
        for x in AT_M:
            stands_m = x + random.normal(0.0, placed_m)
            slope = tangent - TRUE_M / stands_m + random.normal(0.0, error)
            boards.append(Board(x, slope, error, 640))
        found.append(fit(boards, placed_m, 0.1))
    values = np.array([(one.baseline_m, one.beta_rad) for one in found])
    drawn = np.cov(values.T)
    told = np.median([one.covariance / max(1.0, one.chi2_share) for one in found], axis=0)
    np.testing.assert_allclose(told, drawn, rtol=0.15)
    assert np.abs(values.mean(axis=0) - (TRUE_M, math.radians(TRUE_DEG))).max() < 2e-4
    assert np.mean([one.chi2_share for one in found]) == pytest.approx(1.0, abs=0.1)


def test_boards_that_contradict_each_other_are_told(tmp_path: Path, capsys: Capsys) -> None:
    table = pictures(tmp_path)
    table.write_text(table.read_text().replace(",0.7", ",0.74"))
    assert called(tmp_path, table) == 0
    assert "take care: the boards contradict each other" in capsys.readouterr().err


def test_what_does_not_tell_the_plane_is_refused(tmp_path: Path, capsys: Capsys) -> None:
    def refused(table: Path, text: str = SHIPPED) -> tuple[int, str]:
        return called(tmp_path, table, text=text), capsys.readouterr().err

    status, why = refused(pictures(tmp_path, (0.5, 0.55, 0.6)))
    assert (status, "1.3 times as far" in why) == (1, True)
    status, why = refused(pictures(tmp_path, laser=0.0))
    assert (status, "0.jpg: needs a line in 50 columns or more, has 0" in why) == (1, True)
    status, why = refused(pictures(tmp_path, image_px=(320, 240)))
    assert (status, "0.jpg: the camera's images are 320 x 240 px" in why) == (1, True)
    none = tmp_path / "nob.csv"
    assert refused(none) == (2, f"mapod calibrate stripe: {none}: no such file or folder\n")
    (tmp_path / "board.csv").write_text("file,true_m\n0.jpg,near\n")
    status, why = refused(tmp_path / "board.csv")
    assert "line 2: needs a file, and true_m from 0.05 to 30, is '0.jpg' and 'near'" in why
    assert status == 1
    (tmp_path / "board.csv").write_text("file,true_m\n0.jpg,1,5\n")  # a comma for the point
    status, why = refused(tmp_path / "board.csv")
    assert (status, "line 2: has more columns than the first line names" in why) == (1, True)
    (tmp_path / "board.csv").write_bytes(b"file,true_m\n\xff.jpg,1.5\n")
    status, why = refused(tmp_path / "board.csv")
    assert (status, "board.csv: must be UTF-8 text" in why) == (1, True)
    (tmp_path / "board.csv").write_text("file,true_m\n")
    assert "; given are no m" in refused(tmp_path / "board.csv")[1]
    for name in ("0.jpg\0", "a" * 200_000):
        (tmp_path / "board.csv").write_text(f'file,true_m\n"{name}",0.4\n')
        status, why = refused(tmp_path / "board.csv")
        assert (status, "board.csv: line 2: " in why) == (1, True)
    (tmp_path / "board.csv").write_text("name\n")
    assert refused(tmp_path / "board.csv")[0] == 1
    assert refused(tmp_path / "none.csv")[0] == 2
    hokuyo = (ROOT / "robots" / "urg04lx.toml").read_text(encoding="utf-8")
    status, why = refused(pictures(tmp_path), hokuyo)
    assert (status, "scanner.driver: must be 'stripe', is 'urg04lx'" in why) == (2, True)


@pytest.mark.parametrize(
    ("order", "words"),
    [
        ((1, 1, 1, 1, 1), "boards tell a baseline of 0.000 m"),  # one picture at all distances
        ((4, 3, 2, 1, 0), "has the laser on the other side"),
        ((0, 1, 2, 4, 3), "contradict each other"),
    ],
)
def test_a_plane_that_cannot_be_is_refused_and_not_written(
    order: tuple[int, ...], words: str, tmp_path: Path, capsys: Capsys
) -> None:
    table = pictures(tmp_path)
    rows = [f"{k}.jpg,{away_m}" for k, away_m in zip(order, AT_M, strict=True)]
    table.write_text("\n".join(["file,true_m", *rows]) + "\n")
    assert called(tmp_path, table, "--write") == 1
    told = capsys.readouterr()
    assert words in told.err
    assert "[scanner]" not in told.out
    assert (tmp_path / "mapod.toml").read_text() == SHIPPED


def test_a_baseline_that_errors_alone_may_make_is_refused() -> None:
    boards = [Board(x, 0.2 - 0.012 / x, 0.02, 640) for x in AT_M]
    with pytest.raises(PicturesError, match=r"0.012 m, 1 sigma 0.016 m: .* 3 sigma or more"):
        fit(boards, 0.001, 0.1)


def test_too_few_boards_name_what_was_given() -> None:
    with pytest.raises(PicturesError, match=r"given are 0.4, 0.9 m"):
        fit([Board(0.4, 0.0, 1e-4, 1), Board(0.9, 0.1, 1e-4, 1)], 0.001, 0.1)
