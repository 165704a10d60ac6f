"""What is told of a moment, where it must not say more than is known."""

from typing import Any

from tools.why.text import lines_of

MOVING: dict[str, Any] = {"x_m": 1.0, "y_m": 0.0, "yaw_deg": 0.0, "pitch_deg": 0.0, "roll_deg": 0.0}
ZONE: dict[str, Any] = {"state": "clear", "causes": [], "nearest_m": None}
ZONE |= dict.fromkeys(("free_ahead_m", "free_behind_m"), None)
ZONE |= dict.fromkeys(("allowed_ahead_mps", "allowed_behind_mps"), 0.0)


def test_a_robot_that_another_moves_does_not_stand() -> None:
    stands: dict[str, Any] = {"asked": None, "may_move": False, "reason": "", "way_ends_at": None}
    stands |= {"within_margin": 0, "nearest": [], "stops": []}
    moment: dict[str, Any] = {"mode": "running", "pose": MOVING | {"v_mps": 0.6, "w_radps": 0.0}}
    moment |= {"doubts": [], "stands": stands, "zone": ZONE, "inputs": [], "restarts": []}
    moment |= {"refusals": {}}
    told = list(
        lines_of({"utc": "", "t_s": 1.0, "begin_s": 0.0, "moment": moment, "log": [], "cell": None})
    )
    assert "mapod moves no motor: the motors are not enabled" in told
    assert not any(line.startswith("stands") for line in told)
