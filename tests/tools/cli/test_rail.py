"""`mapod rail`: a cart on a rail is mapped where it was typed to stand, and not on its way."""

import math

import pytest

from config_file import load_config, with_changes
from core.motion.external_pose import JUMP_M
from core.motion.pose_track import EXTRAPOLATED_S, LOST_S
from fakes.world.kinematic import KinematicWorld
from fakes.world.trajectory import Way, stand, straight
from mapod_link.receiver import Receiver
from tests import ROOT
from tests.support.robot.closed_loop import ClosedLoop
from tools.cli import rail
from tools.cli.rail import SURE_M, SURE_RAD, TypedRail

STEP_M, REST_S, PUSH_MPS, PUSHES = 0.25, 4.0, 0.5, 8
CART = with_changes(
    load_config((ROOT / "robots" / "cart.toml").read_text(encoding="utf-8")),
    planner={"port": "udp://127.0.0.1:9750"},
)


class Typist:
    """Types where the cart stands, each time that it has come to rest."""

    def __init__(self, world: KinematicWorld) -> None:
        self.rail, self._world, self._due_s, self._typed_m = TypedRail(), world, 0.0, -math.inf

    def step(self, now_s: float, receiver: Receiver) -> None:
        receiver.ask(now_s, geometry=True)
        x_m = self._world.pose(now_s)[0]
        if x_m == self._world.pose(now_s - 0.1)[0] and x_m > self._typed_m:
            assert self.rail.may_move(now_s - 0.1)  # it did not go on too soon
            self._typed_m = x_m
            self.rail.stand(round(x_m, 3), now_s)
        sigma_m = self.rail.maybe_sigma_m(now_s)
        if sigma_m is not None and now_s >= self._due_s:
            self._due_s = now_s + rail.PERIOD_S
            receiver.external_pose(
                now_s, self.rail.distance_m, 0.0, 0.0,
                sigma_x_m=sigma_m, sigma_y_m=SURE_M, sigma_yaw_rad=SURE_RAD,
            )  # fmt: skip


def test_a_cart_is_mapped_where_it_stands_and_not_while_it_is_pushed() -> None:
    hops = [leg for _ in range(PUSHES) for leg in (stand(REST_S), straight(STEP_M, PUSH_MPS))]
    world = KinematicWorld("corridor", Way(*hops, stand(10.0)))
    loop = ClosedLoop(CART, world)
    loop.positioning = Typist(world)  # type: ignore[assignment]
    mapper, off_m, mapped = loop.app.mapper, list[float](), 0

    def look() -> None:
        nonlocal mapped
        if mapper.counts.scans_added > mapped:
            mapped = mapper.counts.scans_added
            at_s = mapper.newest_scan_s
            off_m.append(mapper.odometry.xy_at(at_s)[0] - world.pose(at_s)[0])

    loop.run(PUSHES * (REST_S + 2.0), look)
    assert max(map(abs, off_m)) < 0.005
    assert mapper.counts.erased == 0
    assert mapped > 8 * PUSHES
    assert mapper.counts.scans_dropped > mapped  # what it saw on its way, and while it waited


@pytest.mark.parametrize(
    ("typed", "told"),
    [
        ("0.5\n", "must be at most 0.4 m from 0, is 0.5: the map would begin anew"),
        ("1e9\n", "must be from -1000 to 1000 m, is 1e+09"),
        ("nan\n", "must be from -1000 to 1000 m, is nan"),
        ("0,01\n", "must be a number, is '0,01'"),
    ],
)
def test_what_is_no_distance_is_told_and_the_cart_stands_where_it_stood(
    typed: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    cart = TypedRail()
    assert rail._take("\n", cart, 0.01, 1.0)  # Enter alone: where the rail begins
    assert rail._take(typed, cart, 0.01, 9.0)
    assert capsys.readouterr().err == told + "\n"
    assert (cart.distance_m, cart.may_move(9.0), cart.maybe_sigma_m(2.0)) == (0.0, True, SURE_M)
    assert rail._take("\n", cart, 0.01, 9.0)  # and from then on a step farther
    assert cart.distance_m == 0.01
    assert not rail._take("", cart, 0.01, 20.0)


def test_its_times_and_ways_are_beyond_those_of_the_track() -> None:
    assert EXTRAPOLATED_S < rail.SILENT_S < LOST_S
    assert rail.FARTHEST_M < JUMP_M


def test_a_port_that_is_none_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert rail.main(["--port", "udp://nowhere"]) == 2
    assert capsys.readouterr().err.startswith("mapod rail: udp://nowhere")
