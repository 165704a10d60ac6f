"""Lines of floor are remembered by heading and place, and tried once the robot has turned away."""

import math
import random

from core.mapping.beams.ground_memory import AWAY_RAD, NEAR_M, GroundMemory, Turning
from core.mapping.beams.ground_plane import GroundPlane
from core.mapping.body import BodyPose


def stand(yaw_deg: float, x_m: float = 0.0) -> BodyPose:
    yaw = math.radians(yaw_deg)
    return BodyPose(x_m, 0.0, 0.0, (math.cos(yaw), math.sin(yaw)), (0.0, 0.0), x_m)


def line(z_m: float) -> GroundPlane:
    return GroundPlane(8.0, 0.0, z_m, 0.0, 0.0, 0.0)


def test_a_line_is_tried_again_where_the_robot_looks_as_it_did() -> None:
    memory = GroundMemory()
    for yaw_deg, z_m in ((0.0, 0.1), (90.0, 0.2), (-170.0, 0.3)):
        memory.keep(line(9.9), stand(yaw_deg))
        memory.keep(line(z_m), stand(yaw_deg))  # the newest of a sector counts
    assert memory.near(stand(0.0)) == []  # it has not turned away
    memory.turn(1.1 * AWAY_RAD)
    found = [[kept.z_m for kept in memory.near(stand(yaw))] for yaw in (5.0, 80.0, 180.0, 45.0)]
    assert found == [[0.1], [0.2], [0.3], []]
    assert len(memory.near(stand(0.0, 0.9 * NEAR_M))) == 1
    assert memory.near(stand(0.0, 1.1 * NEAR_M)) == []
    memory.forget()
    assert memory.near(stand(0.0)) == []


def test_a_heading_that_jitters_does_not_turn_and_a_robot_that_turns_does() -> None:
    jitter, turning, noise = Turning(), Turning(), random.Random(5)
    yaws = [noise.gauss(0.0, 0.003) for _ in range(500)]
    for k, yaw in enumerate(yaws):
        assert jitter.step(0.04 * k, stand(math.degrees(yaw)).heading) == 0.0
    times_s = [0.04 * k for k in range(101)]
    told = sum(turning.step(t_s, stand(math.degrees(0.6 * t_s)).heading) for t_s in times_s)
    assert 0.85 * 2.4 < told <= 2.4
    assert turning.step(9.0, stand(0.0).heading) == 0.0, "who knows what was between"
