"""Jobs in processes: what crashes is told, what is killed is tried again, what is done is kept."""

import json
import os
import signal
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from tests.support.sweep_work import always_killed, killed, refused, squared
from tools.sweep.engine import Done, done_before, run_missing
from tools.sweep.jobs import Failure, SchedulerError, rate_text, with_bar
from tools.sweep.local import KILLED, LocalProcesses
from tools.sweep.rows import FolderError, Rows

WHAT = {"kind": "test", "seed": 1}
TASKS = {f"job {number}": number for number in range(3)}


class Here:
    """Does jobs in this process; after `most` of them somebody pulls the plug."""

    def __init__(self, most: int = 99) -> None:
        self.most, self.did = most, list[Any]()

    def results(self, work: Any, tasks: Any) -> Generator[tuple[int, Any], None, None]:
        for at, task in enumerate(tasks):
            if at >= self.most:
                raise SchedulerError("the plug was pulled")
            self.did.append(task)
            yield at, work(task)


def row(number: int) -> dict[str, Any]:
    return {"square": number * number}


def lines_in(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "rows.jsonl").read_text("utf-8").splitlines()]


def test_a_crash_is_told_and_the_other_jobs_go_on() -> None:
    found = dict(LocalProcesses(2).results(refused, [0, 1, 2]))
    assert (found[0], found[2]) == ({"square": 0}, {"square": 4})
    assert isinstance(found[1], Failure)
    assert found[1].cause.endswith("ValueError: one is refused")


def test_a_killed_process_loses_one_job_which_is_tried_once_more(tmp_path: Path) -> None:
    marks = [tmp_path / "a", tmp_path / "b", tmp_path / "c"]
    assert sorted(LocalProcesses(2).results(killed, marks)) == [
        (k, {"done": True}) for k in (0, 1, 2)
    ]
    found = dict(LocalProcesses(2).results(always_killed, [0, 1, 2]))
    assert found == {0: {"square": 0}, 1: Failure(KILLED), 2: {"square": 4}}


def test_what_was_done_is_not_done_again(tmp_path: Path) -> None:
    with Rows(tmp_path / "rows", WHAT) as rows, pytest.raises(SchedulerError):
        list(run_missing(row, TASKS, rows, Here(most=2)))
    with Rows(tmp_path / "rows", WHAT) as rows:
        assert [done.key for done in done_before(TASKS, rows)] == ["job 0", "job 1"]
        rest = Here()
        assert list(run_missing(row, TASKS, rows, rest)) == [Done("job 2", {"square": 4})]
        assert rest.did == [2]
    assert [line["key"] for line in lines_in(tmp_path / "rows")] == list(TASKS)


def test_a_job_that_failed_is_a_row_and_is_tried_again_at_the_next_start(tmp_path: Path) -> None:
    with Rows(tmp_path, WHAT) as rows:
        ended = {done.key: done for done in run_missing(refused, TASKS, rows, LocalProcesses(1))}
    assert ended["job 1"].failed.endswith("one is refused")
    assert sum("failed" in line for line in lines_in(tmp_path)) == 1
    with Rows(tmp_path, WHAT) as rows:
        again = Here()
        list(run_missing(row, TASKS, rows, again))
        assert again.did == [1]
    with Rows(tmp_path, WHAT) as rows:
        assert rows.kept.keys() == TASKS.keys()


@given(cut=st.integers(1, 200))
def test_a_row_that_power_loss_cut_is_lost_alone(
    cut: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("cut")
    with Rows(folder, WHAT) as rows:
        list(run_missing(row, TASKS, rows, Here()))
    file = folder / "rows.jsonl"
    whole = file.read_bytes()
    left = whole[: max(0, len(whole) - cut)]
    file.write_bytes(left)
    with Rows(folder, WHAT) as rows:
        assert len(rows.kept) == left.count(b"\n")
        list(run_missing(row, TASKS, rows, Here()))
    assert sorted(line["key"] for line in lines_in(folder)) == sorted(TASKS)


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    with Rows(tmp_path / "mine", WHAT), pytest.raises(FolderError, match="another process"):
        Rows(tmp_path / "mine", WHAT)
    with pytest.raises(FolderError, match="another sweep: its seed is 1, not 2"):
        Rows(tmp_path / "mine", WHAT | {"seed": 2})
    other = tmp_path / "other"
    other.mkdir()
    (other / "letter.txt").touch()
    with pytest.raises(FolderError, match=r"other things \(letter.txt\)"):
        Rows(other, WHAT)
    assert [path.name for path in other.iterdir()] == ["letter.txt"]


def test_without_a_screen_progress_is_a_line_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tools.sweep.jobs.TOLD_EVERY_S", 0.0)
    console = Console(width=80, no_color=True)
    with console.capture() as told:
        seen = list(with_bar(console, 4, iter("ab"), "".join, done=["x", "y"], noun="jobs"))
    assert seen == ["a", "b"]
    assert told.get().splitlines()[-1].startswith("  4 of 4 jobs: xyab; 0 s left")
    assert [rate_text(per_s) for per_s in (0.0, 2.5, 0.1, 0.001)] == [
        "",
        "2.5/s",
        "6.0/min",
        "3.6/h",
    ]


@pytest.mark.slow
def test_a_cluster_that_loses_a_worker_has_every_row_and_none_twice(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    from tools.sweep.cluster import DaskCluster

    tasks = {f"job {number}": number for number in range(24)}
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
        ) as cluster,
        Rows(tmp_path, WHAT) as rows,
    ):
        ended: list[Done] = []
        for done in run_missing(squared, tasks, rows, DaskCluster(cluster.scheduler_address)):
            ended.append(done)
            if len(ended) == 4:
                os.kill(done.row["worker"], signal.SIGKILL)
    lines = lines_in(tmp_path)
    assert sorted(line["key"] for line in lines) == sorted(tasks)
    assert {line["key"]: line["square"] for line in lines} == {k: n * n for k, n in tasks.items()}
    assert len({line["worker"] for line in lines}) > 2, "the killed one was replaced"
    assert len(ended) == len(tasks)
