"""`mapod export` of a recorded drive: the files hold what the app heard and made of it."""

import csv
from pathlib import Path

import numpy as np
import pytest

from tests import Capsys
from tests.support.robot.recorded import RecordedLoop
from tests.support.robot.shipped import shipped
from tests.tools.export.test_files import occupancy, read_pcd
from tools.cli.export import main


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[RecordedLoop, Path]:
    """Four seconds of a drive."""
    path = tmp_path_factory.mktemp("export") / "drive.mcap"
    loop = RecordedLoop(path, shipped())
    loop.run(4.0)
    loop.recorder.close()
    return loop, path


def exported(run: tuple[RecordedLoop, Path], folder: Path, *given: str) -> Path:
    assert main([str(run[1]), "--out", str(folder), *given]) == 0
    return folder


def rows_of(path: Path) -> list[dict[str, float]]:
    with path.open(newline="") as file:
        return [
            {name: float(text or "nan") for name, text in row.items()}
            for row in csv.DictReader(file)
        ]


def test_tables_end_where_the_run_did(
    run: tuple[RecordedLoop, Path], tmp_path: Path, capsys: Capsys
) -> None:
    loop, folder = run[0], exported(run, tmp_path, "--to", "csv")
    assert capsys.readouterr().err == ""  # the replay is the run, to the bit
    pose = loop.app.mapper.maybe_pose(loop.now_s)
    assert pose is not None
    last = rows_of(folder / "pose.csv")[-1]
    assert last["x_m"] > 0.05
    assert last["x_m"] == pytest.approx(pose.x_m, abs=0.05)
    assert rows_of(folder / "health.csv")[-1]["mode"] == 1
    scans, attitude = rows_of(folder / "scans.csv"), rows_of(folder / "attitude.csv")
    assert len({row["counter"] for row in scans}) >= loop.app.mapper.counts.scans_added
    assert all(np.hypot(row["q_w"], row["q_z"]) > 0.99 for row in attitude)
    counts = [row["left_counts"] for row in rows_of(folder / "wheels.csv")]
    assert counts[-1] > counts[0] + 100
    times_s = [row["t_s"] for row in attitude]
    assert times_s == sorted(times_s)


def test_points_stand_where_the_map_has_something(
    run: tuple[RecordedLoop, Path], tmp_path: Path
) -> None:
    """What stands well above the floor lies in cells that are occupied, or just beside them."""
    exported(run, tmp_path, "--to", "ros")
    points = read_pcd(exported(run, tmp_path, "--to", "pcd") / "points.pcd")
    assert len(points["x"]) == pytest.approx(run[0].app.mapper.counts.points, rel=0.01)
    stands = (points["z"] > 0.3) & (np.hypot(points["x"], points["y"]) < 5.0)
    places = np.column_stack([points["x"], points["y"]])[stands][::20]
    assert len(places) > 100
    told = [occupancy(tmp_path, x_m, y_m) for x_m, y_m in places]
    assert told.count("occupied") > 0.9 * len(told)


def test_an_instant_cuts_the_drive(run: tuple[RecordedLoop, Path], tmp_path: Path) -> None:
    early = exported(run, tmp_path / "a", "--to", "csv", "--at", "1.5")
    late = exported(run, tmp_path / "b", "--to", "csv")
    begin, end = rows_of(early / "attitude.csv"), rows_of(late / "attitude.csv")
    assert begin == end[: len(begin)]
    assert begin[-1]["t_s"] - end[0]["t_s"] == pytest.approx(1.4, abs=0.2)
    one = read_pcd(exported(run, tmp_path / "c", "--to", "pcd", "--at", "3") / "points.pcd")
    assert len(set(one["t"])) == 1  # the newest sweep


@pytest.mark.parametrize(
    ("given", "status", "words"),
    [
        (["--to", "png", "--at", "soon"], 2, "--at: must be seconds from the begin, "),
        (["--to", "png", "--at", "99"], 2, "--at: 99 is not within the recording"),
        (["--to", "png", "--at", "0"], 1, "no sweep was mapped until then"),
        (["--to", "pcd", "--at", "0"], 1, "no sweep was mapped until then"),
    ],
)
def test_what_can_not_be_had_is_said_in_a_line(
    run: tuple[RecordedLoop, Path],
    tmp_path: Path,
    capsys: Capsys,
    given: list[str],
    status: int,
    words: str,
) -> None:
    assert main([str(run[1]), "--out", str(tmp_path), *given]) == status
    told = capsys.readouterr().err
    assert words in told
    assert len(told.splitlines()) == 1


def test_a_recording_that_was_cut_off_says_so(
    run: tuple[RecordedLoop, Path], tmp_path: Path, capsys: Capsys
) -> None:
    whole = run[1].read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    given = [str(tmp_path / "cut.mcap"), "--to", "csv", "--out", str(tmp_path)]
    assert main(given) == 0
    assert capsys.readouterr().err == (
        "mapod export: the recording was cut off: this is all that it holds\n"
    )
    assert len(rows_of(tmp_path / "attitude.csv")) > 100


def test_what_is_no_recording_is_one_line(tmp_path: Path, capsys: Capsys) -> None:
    (tmp_path / "junk.mcap").write_bytes(b"junk" * 1000)
    for name, status in (("junk.mcap", 1), ("none.mcap", 2)):
        assert main([str(tmp_path / name), "--to", "csv", "--out", str(tmp_path)]) == status
        told = capsys.readouterr().err
        assert name in told
        assert len(told.splitlines()) == 1
