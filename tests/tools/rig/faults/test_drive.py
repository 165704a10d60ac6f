"""What is made of a drive's moments, and the table of them, by hand-made drives."""

from collections.abc import Callable
from dataclasses import replace
from io import StringIO

import pytest
from rich.console import Console

from tools.rig.fault_table import Job, Row, cells, jobs, markdown, show, summary
from tools.rig.faults.catalogue import CATALOGUE, Fault, either, goes_on, stops
from tools.rig.faults.drive import ALL_WELL, Moment, Outcome, fill_in, problems, problems_of_pair
from tools.rig.faults.stripe import STRIPE
from tools.rig.faults.urg04lx import URG04LX

STEP_S, END_S = 0.02, 20.0
FAULT = stops("scanner.mute", "no scans")
NOISE, DEAF = either("scanner.noise_m", "may be", "0.05"), goes_on("ahrs.deaf", "data come on")


def goes(t_s: float) -> float:
    return 0.4


def driven(
    speed_mps: Callable[[float], float],
    health: Callable[[float], int] = lambda t_s: ALL_WELL,
    wants: Callable[[float, float], bool] = lambda t_s, v_mps: v_mps > 0,
) -> Outcome:
    """A drive with a fault from 5 to 8 s, at the speed of each instant."""
    outcome, moments, x_m = Outcome(5.0, 8.0), [], 0.0
    for k in range(round(END_S / STEP_S)):
        t_s = k * STEP_S
        v_mps = speed_mps(t_s)
        reason = "" if v_mps else "no scans"
        moments.append(Moment(t_s, x_m, 0.0, v_mps > 0, wants(t_s, v_mps), health(t_s), reason))
        x_m += v_mps * STEP_S
    fill_in(moments, outcome)
    return outcome


def stops_between(from_s: float, to_s: float) -> Callable[[float], float]:
    return lambda t_s: 0.0 if from_s <= t_s < to_s else 0.4


def test_times_count_from_the_faults_begin_and_from_its_end() -> None:
    outcome = driven(
        stops_between(5.6, 9.1), lambda t_s: ALL_WELL & ~1 if 5.2 <= t_s < 8.7 else ALL_WELL
    )
    assert outcome.stood_s == pytest.approx(0.6, abs=0.05)
    assert outcome.blind_m == pytest.approx(0.24, abs=0.02)
    assert outcome.told_s == pytest.approx(0.2, abs=0.03)
    assert outcome.told == ("scanner",)
    assert outcome.well_s == pytest.approx(0.7, abs=0.05)
    assert outcome.again_s == pytest.approx(1.1, abs=0.06)
    assert outcome.reason == "no scans"
    assert problems(FAULT, outcome) == []
    outcome = driven(goes)
    assert outcome.stood_s is None
    assert outcome.blind_m == pytest.approx(1.2, abs=0.02)
    assert (outcome.well_s, outcome.again_s) == (0.0, 0.0)


def ill_from(from_s: float) -> Callable[[float], int]:
    return lambda t_s: 0 if t_s > from_s else ALL_WELL


@pytest.mark.parametrize(
    ("fault", "outcome", "found"),
    [
        (FAULT, driven(goes), ["did not stop"]),
        (DEAF, driven(goes), []),
        (NOISE, driven(goes), []),
        (FAULT, driven(stops_between(7.5, 9.0)), ["stood after 2.5 s only, must after 2 s"]),
        (DEAF, driven(stops_between(7.5, 9.0)), ["stopped: no scans"]),
        (FAULT, driven(stops_between(5.5, END_S)), ["did not drive again"]),
        (replace(FAULT, again=False), driven(stops_between(5.5, END_S)), []),
        (
            FAULT,
            driven(stops_between(5.5, 9.0), ill_from(5.2)),
            ["well again never, must within 6 s"],
        ),
    ],
)
def test_what_is_not_as_told_is_a_problem(fault: Fault, outcome: Outcome, found: list[str]) -> None:
    assert problems(fault, outcome) == found


def test_power_that_mapod_has_not_wanted_for_long_is_harm() -> None:
    brakes = driven(stops_between(5.6, 9.1), wants=lambda t_s, v_mps: v_mps > 0 and t_s < 5.2)
    assert brakes.unbidden_s > 10.0
    assert any("after mapod had wanted none" in problem for problem in problems(FAULT, brakes))
    soon = driven(stops_between(5.6, 9.1), wants=lambda t_s, v_mps: not 5.2 < t_s < 9.05)
    assert soon.unbidden_s == pytest.approx(0.4, abs=0.05)


def test_a_pair_must_do_what_the_stricter_of_both_must_and_harm_is_a_problem_in_any_case() -> None:
    harmful = driven(stops_between(5.6, 9.1))
    harmful.collisions.append("a box")
    harmful.wrong_free.append("(1.0, 2.0)")
    assert len(problems(NOISE, harmful)) == len(problems_of_pair([NOISE, FAULT], harmful)) == 2
    assert problems_of_pair([FAULT, DEAF], driven(goes)) == ["did not stop"]
    assert problems_of_pair([NOISE, DEAF], driven(goes)) == []


def test_a_campaign_has_each_fault_as_often_as_asked_and_pairs_of_two_devices() -> None:
    found = jobs(pairs=50, rounds=2, seed=3)
    assert len(found) == 2 * len(CATALOGUE + URG04LX + STRIPE) + 50
    assert found == jobs(pairs=50, rounds=2, seed=3)
    pairs = [job for job in found if len(job.faults) == 2]
    assert all(job.faults[0].device != job.faults[1].device for job in pairs)
    assert not any(fault.robot for job in pairs for fault in job.faults)
    assert len(jobs(0, 1, 1, only="planner.mute")) == 1


def test_the_tables_tell_all_drives_and_what_is_wrong() -> None:
    stands, waits = driven(stops_between(5.6, 9.1)), driven(stops_between(5.5, END_S))
    rows = [
        Row(Job((FAULT,), 1, 5.0), stands),
        Row(Job((FAULT, DEAF), 2, 5.0), driven(goes), ["did not stop"]),
        Row(Job((FAULT,), 1, 5.0), None, ["crashed: ValueError: x"]),
        Row(Job((replace(FAULT, again=False),), 1, 5.0), waits),
    ]
    out = StringIO()
    show(rows, Console(file=out, width=250))
    told = out.getvalue()
    assert "4 drives, 2 not as they must be" in told
    assert "scanner.mute AND ahrs.deaf (seed 2, 5 s): did not stop" in told
    assert "crashed: ValueError: x" in told
    assert [line[0] for line in summary(rows)] == ["scanner", "pairs"]
    lines = markdown(rows).splitlines()
    assert any(line.startswith("| scanner.mute | stops | 0.6") for line in lines)
    assert not any("AND" in line for line in lines)
    assert cells(rows[3])[-2] == "waits"
