"""The C planner where numbers are large, small or of another robot: no sum overflows."""

from dataclasses import replace

import pytest

from config_file import load_config, with_changes
from core.config import Config, ConfigError
from core.records import FREE, OBSTACLE
from tests.support.link.c_bench import Bench, set_out
from tools.rig.planner.build import ROOT, robot_from_config, shipped_robot
from tools.rig.planner.host import PlannerSettings

JUMP_M = 100.0


@pytest.mark.parametrize("side", [-1, 1])
def test_it_backs_towards_where_it_came_from_though_the_pose_has_jumped_far(side: int) -> None:
    bench = Bench()
    set_out(bench, 8.0, 0.0)
    bench.run(5.0)
    bench.put((7.0, 7.4), (-0.4, 0.4), OBSTACLE)
    while bench.state.recovery != "back":
        assert bench.now_s < 130.0
        bench.tick()
    bench.cells[:] = FREE
    bench.jump(side * JUMP_M)
    bench.run(0.5)
    v_mps, w_radps = bench.newest
    assert v_mps < 0.0
    assert w_radps * side > 0.0, "its rear turns towards the origin"


def test_a_goal_ten_kilometres_off_is_driven_to_at_full_speed() -> None:
    bench = Bench()
    set_out(bench, 10_000.0, 0.0)
    bench.run(4.0)
    assert bench.newest[0] > 0.5


@pytest.mark.parametrize(("cell_mm", "state"), [(1, "stopped"), (10, "driving"), (1001, "stopped")])
def test_windows_of_cells_that_are_too_small_or_too_large_are_refused(
    cell_mm: int, state: str
) -> None:
    bench = Bench()
    bench.cell_mm = cell_mm
    bench.begin_link()
    bench.run(0.3)
    bench.planner.goal(8.0, 0.0)
    bench.run(0.5)
    assert bench.state.state == state
    assert ("cells" in bench.state.why) == (state == "stopped")


def config_of(**scanner: float) -> Config:
    """The settings as shipped, with another mount."""
    shipped = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
    return with_changes(shipped, scanner=scanner)


def test_what_depends_on_robot_and_mount_comes_from_the_settings() -> None:
    assert shipped_robot() == robot_from_config(config_of())
    assert shipped_robot().line_mm == 8450
    higher = robot_from_config(config_of(mount_z_m=1.30, mount_tilt_deg=10.0))
    assert higher.line_mm == 7620


@pytest.mark.parametrize(
    ("scanner", "message"),
    [
        ({"mount_tilt_deg": 0.5}, "looks down on the ground, by 1 deg or more, it is 0.5"),
        ({"mount_tilt_deg": 1.5}, "1 to 30 m ahead of the drive axle, it does so at 41.49 m"),
        ({"mount_tilt_deg": 80.0}, "it does so at 0.44 m"),
    ],
)
def test_a_mount_that_shows_no_ground_ahead_is_refused(
    scanner: dict[str, float], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        robot_from_config(config_of(**scanner))


def test_a_longer_robot_keeps_farther_off_a_wall() -> None:
    stood_m = []
    for front_mm in (520, 1500):
        bench = Bench(PlannerSettings(robot=replace(shipped_robot(), front_mm=front_mm)))
        bench.put((3.0, 3.4), (-10.2, 10.2), OBSTACLE)
        set_out(bench, 2.0, 0.0)
        farthest: list[float] = []
        bench.run(10.0, lambda b=bench, f=farthest: f.append(b.place[0]))  # type: ignore[misc]
        stood_m.append(max(farthest))
    assert stood_m[0] > 1.7
    assert 0.5 < stood_m[1] < 3.0 - 1.5 - 0.15
