"""A robot with another scanner than the shipped one drives as well, and touches nothing."""

import pytest

from config_file import load_config, with_changes
from fakes.scenes.scene import load_scene
from tests import ROOT
from tools.rig.planner.host import CPlanner, PlannerSettings
from tools.rig.runs.one_run import Run, RunSpec


def run_of(robot: str, name: str, seed: int, limit_s: float) -> Run:
    scene = load_scene(name, seed)
    text = (ROOT / "robots" / f"{robot}.toml").read_text(encoding="utf-8")
    clear = {"enable_motors": True, "start_clear_m": scene.start_clear_m}
    pilot = CPlanner(PlannerSettings(start_clear_m=scene.start_clear_m))
    config = with_changes(load_config(text), robot=clear)
    return Run(RunSpec(scene, seed, limit_s=limit_s), pilot, config)


@pytest.mark.slow
def test_a_hokuyo_scanner_brings_the_robot_to_its_goal() -> None:
    run = run_of("urg04lx", "turn", 22, 200.0)
    result = run.to_end()
    assert not result.collisions
    assert result.reached == result.goals > 0, result.missed
    assert run.loop.app.devices.scanner.status.missed == 0
