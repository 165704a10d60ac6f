"""What the real process uses: how it is counted and kept, and that counts have not grown."""

import json
import os
import threading
import time
from pathlib import Path

import pytest
from rich.console import Console

from tests import Patch
from tools.bench import history
from tools.bench.history import BOUNDS, entry, grown, keep, kept_entries, table_of
from tools.bench.peer import rounds_from_text
from tools.bench.process import ROWS, SETTINGS, measured
from tools.bench.syscalls import StraceError, calls_per_s, counts_from_text, kernels_loaded
from tools.bench.usage import Usage, cpu_s, rates_between, resident_mb, usage_of
from tools.terminal.processes import Stop

SHORT_S = 6.0
TRIES = 3
NOBODY = 2**22 + 1  # beyond the largest number that a process can have
COUNTED = """% time     seconds  usecs/call     calls    errors syscall
------ ----------- ----------- --------- --------- ----------------
 62.50    0.000025           5       203         1 epoll_wait
 37.50    0.000015           5         3           read
------ ----------- ----------- --------- --------- ----------------
100.00    0.000040           5       206         1 total
"""


def usage(at_s: float, cpu: float, **threads: tuple[int, int]) -> Usage:
    by_id = {int(name[1:]): of for name, of in threads.items()}
    return Usage(at_s, cpu, round(10 * at_s), 0, by_id)


def test_rates_are_those_between_two_looks_and_the_busiest_thread_is_the_loop() -> None:
    before = usage(10.0, 1.0, t7=(900, 4000), t8=(100, 50))
    after = usage(12.0, 1.5, t7=(1000, 4010), t8=(400, 1050), t9=(0, 3))
    rates = rates_between(before, after)
    assert rates.cpu == 0.25
    assert (rates.wakeups, rates.other_wakeups) == (500.0, 5.0)  # a new thread is not known yet
    assert (rates.minor_faults, rates.major_faults) == (10.0, 0)


def test_the_kernels_counters_of_a_process_are_read() -> None:
    own, waits = os.getpid(), threading.Event()
    before_s, before = time.process_time(), usage_of(own)
    for _ in range(20):
        waits.wait(1e-4)
    after, after_s = usage_of(own), time.process_time()
    assert 0 < after.cpu_s - before.cpu_s <= after_s - before_s
    this = threading.get_native_id()
    assert after.threads[this][1] - before.threads[this][1] >= 20
    resident, locked = resident_mb(own)
    assert 20 < resident < 4000
    assert 0 <= locked <= resident
    assert cpu_s(own) >= after.cpu_s


def test_calls_and_rounds_are_read_from_what_others_print() -> None:
    assert counts_from_text(COUNTED) == {"epoll_wait": 203, "read": 3}
    assert rounds_from_text("5.000000 0.000400\n5.100000 0.000500\n5.2") == [
        (5.0, 0.0004),
        (5.1, 0.0005),
    ]


def test_where_strace_is_not_there_or_may_not_look_it_says_so(
    tmp_path: Path, monkeypatch: Patch
) -> None:
    with pytest.raises(StraceError, match=r"strace is not there|attach|No such process"):
        calls_per_s(NOBODY, lambda: None, lambda pid: None)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(StraceError, match="apt install strace"):
        kernels_loaded(["true"], tmp_path)


def test_a_count_that_has_grown_is_named_and_a_time_never_is() -> None:
    kept = {"shipped.calls_per_s": 1000.0, "shipped.wakeups_per_s": 200.0, "start.modules": 700.0}
    times = {"shipped.first_map_s": 9.0, "shipped.cpu_percent": 90.0}
    same = {**kept, **times, "fast.calls_per_s": 9000.0}
    assert grown({**kept, **dict.fromkeys(times, 1.0)}, same) == []
    bound = BOUNDS["calls_per_s"]
    most = 1000.0 * (1 + bound.share) + bound.more
    assert grown(kept, {**kept, "shipped.calls_per_s": most}) == []
    [words] = grown(kept, {**kept, "shipped.calls_per_s": most + 1})
    assert words.startswith("shipped.calls_per_s: 1351, kept is 1000")
    assert {name.rpartition(".")[2] for name, _, _ in ROWS} >= BOUNDS.keys()


def test_kept_figures_stand_beside_the_new_ones(tmp_path: Path) -> None:
    path, figures = tmp_path / "kept.jsonl", {"shipped.wakeups_per_s": 250.04, "start.modules": 8.0}
    assert kept_entries(path) == []
    for value in (1.0, 8.0):
        keep(entry({**figures, "start.modules": value}, {"shipped": {"read": 9.0}}), path)
    *_, kept = kept_entries(path)
    assert kept["figures"] == {"shipped.wakeups_per_s": 250.0, "start.modules": 8.0}
    assert kept["calls_per_s"] == {"shipped": {"read": 9.0}}
    console = Console(width=100)
    with console.capture() as shown:
        console.print(table_of(["shipped"], ROWS, {**figures, "start.modules": 12.0}, kept))
    lines = [line.split() for line in shown.get().splitlines() if line.strip()]
    assert ["modules", "imported", "12", "8", "+50", "%"] in lines
    assert ["wake-ups", "of", "the", "loop", "/s", "250", "250"] in lines
    assert not any("calls" in line for line in lines)


def test_the_history_is_whole() -> None:
    newest = kept_entries()[-1]
    named = {f"{setting}.{name}" for setting in SETTINGS for name in ("calls_per_s", "resident_mb")}
    assert named <= newest["figures"].keys()
    assert all(json.loads(line) for line in history.FILE.read_text().splitlines())


@pytest.mark.real_time
def test_the_real_process_uses_no_more_than_was_kept() -> None:
    kept = kept_entries()[-1]["figures"]
    with Stop().on_signals() as stop:
        new = measured(SHORT_S, stop, list(SETTINGS))
        least = dict(new.figures)
        for _ in range(TRIES - 1):  # others on the machine only add
            if not grown(kept, least):
                break
            again = measured(SHORT_S, stop, list(SETTINGS)).figures
            least |= {name: min(value, again.get(name, value)) for name, value in least.items()}
    assert grown(kept, least) == []
    assert {name for name in new.figures if name.endswith(".wakeups_per_s")} == {
        f"{setting}.wakeups_per_s" for setting in SETTINGS
    }
    if not all(new.calls.values()):
        pytest.skip("; ".join(new.remarks))
