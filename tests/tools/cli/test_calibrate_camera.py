"""`mapod calibrate camera`: over pictures of chessboards that are drawn, and what it refuses."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from config_file import load_config
from tests import ROOT, Capsys
from tests.tools.calibration.chessboards import HELD, picture
from tools.cli import calibrate

pytestmark = pytest.mark.slow

pytest.importorskip("cv2", reason="needs OpenCV: pip install 'mapod[camera]'")
SHIPPED = (ROOT / "robots" / "ragno.toml").read_text(encoding="utf-8")
FOCAL_PX, CENTRE_PX, DISTORTION = (612.0, 607.0), (327.0, 234.0), (-0.18, 0.05, 0.001, -0.001, 0.0)


@pytest.fixture(scope="module")
def boards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("boards")
    for k, held in enumerate(HELD):
        image = picture(held, FOCAL_PX, CENTRE_PX, DISTORTION, k)
        Image.fromarray(image).save(folder / f"{k:02d}.jpg", quality=92)
    return folder


def called(folder: Path, pictures: Path, *more: str, text: str = SHIPPED) -> int:
    (folder / "mapod.toml").write_text(text)
    given = ["camera", "--pictures", str(pictures), "--config", str(folder / "mapod.toml")]
    if "--board" not in more:
        more = (*more, "--board", "9x6")
    return calibrate.main([*given, "--square", "0.025", *more])


def test_the_lens_is_found_and_written(tmp_path: Path, boards: Path, capsys: Capsys) -> None:
    assert called(tmp_path, boards, "--write") == 0
    told = capsys.readouterr()
    assert told.err == ""
    rows = [line.split() for line in told.out.splitlines()[1:9]]
    for row, true in zip(rows, (*FOCAL_PX, *CENTRE_PX, *DISTORTION), strict=False):
        assert abs(float(row[2]) - true) < 4 * float(row[4]), row
    scanner: Any = load_config((tmp_path / "mapod.toml").read_text()).scanner.options
    np.testing.assert_allclose(scanner.focal_px, FOCAL_PX, rtol=1e-3)
    np.testing.assert_allclose(scanner.centre_px, CENTRE_PX, atol=2.0)
    assert f"distortion = {[round(x, 6) for x in scanner.distortion[:4]]}"[:-1] in told.out
    assert scanner.distortion[4] == 0.0
    rms_px, now_px = map(float, re.findall(r"by ([0-9.]+) px", told.out))
    assert 3 * rms_px < 0.6 < now_px


def test_each_bad_picture_is_named_and_left_out(
    tmp_path: Path, boards: Path, capsys: Capsys
) -> None:
    folder = tmp_path / "boards"
    folder.mkdir()
    for path in sorted(boards.iterdir())[:5]:
        (folder / path.name).write_bytes(path.read_bytes())
    whole = (folder / "00.jpg").read_bytes()
    (folder / "cut.jpg").write_bytes(whole[: len(whole) // 2])
    (folder / "text.png").write_text("no picture")
    (folder / "notes.txt").write_text("not looked at")
    Image.new("RGB", (640, 480), "grey").save(folder / "empty.jpg")
    Image.new("RGB", (320, 240), "grey").save(folder / "small.jpg")
    assert called(tmp_path, folder) == 0
    told = capsys.readouterr().err.splitlines()
    assert [line.partition("left out: ")[2][:47] for line in told[:4]] == [
        "cut.jpg: a JPEG that lacks part of its image",
        "empty.jpg: no board of 9 x 6 inner corners in i",
        "small.jpg: the camera's images are 320 x 240 px",
        "text.png: an image that can't be decoded",
    ]
    assert "few pictures: 5" in told[4]


def test_what_can_not_be_is_refused(tmp_path: Path, boards: Path, capsys: Capsys) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    assert called(tmp_path, empty) == 1
    assert "has no pictures" in capsys.readouterr().err
    assert called(tmp_path, tmp_path / "none") == 2
    with pytest.raises(SystemExit, match="2"):
        called(tmp_path, boards, "--board", "9")
    assert "as 9x6, each from 3 to 50; is '9'" in capsys.readouterr().err
    hokuyo = (ROOT / "robots" / "urg04lx.toml").read_text(encoding="utf-8")
    assert called(tmp_path, boards, text=hokuyo) == 2
    assert "must be 'stripe', is 'urg04lx'" in capsys.readouterr().err
    assert called(tmp_path, boards, text="") == 2
    assert f"{tmp_path / 'mapod.toml'}: " in capsys.readouterr().err
