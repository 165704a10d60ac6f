"""Whatever comes, stays away and comes back, in any order: what must hold of the app then."""

import contextlib

from hypothesis import Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from core.saved.encoding import StateError
from core.saved.state import state_of
from fakes.scenes.scene import Scene, Solid
from tests.support.cases import examples
from tests.support.robot.closed_loop import ClosedLoop
from tests.support.robot.shipped import FLOOR, shipped

BOX = Solid("box", (3.41, 4.19), (-0.79, 0.79), (0.0, 0.9))
IN_THE_BOX_M = ((3.7, -0.5), (3.9, 0.1), (3.7, 0.5))
INPUTS = ("scanner", "ahrs", "drive")
STANDS_S = 1.2  # after the longest limit of an input, a ramp, and the controller's own watchdog
NOT_FREE_S = 0.45 + 0.15 + 0.5  # after that limit, one of the link, and its repair
VALID_S = 0.3
CONFIG = shipped(robot={"enable_motors": True, "start_clear_m": 3.0})


class AppLife(RuleBasedStateMachine):
    """A simulated robot before a box, its planner, and all that may befall them."""

    def __init__(self) -> None:
        super().__init__()
        self.loop = ClosedLoop(CONFIG, Scene("hall", (FLOOR, BOX)), drives=False)
        self.silent_s: dict[str, float] = {}  # since when, by input
        self.asked_s = float("-inf")  # newest request to move

    @initialize()
    def begin(self) -> None:
        self.loop.run(1.7)

    @rule(name=st.sampled_from(INPUTS), fault=st.sampled_from(["mute", "cut"]))
    def an_input_stops(self, name: str, fault: str) -> None:
        setattr(self.loop.wires[name], fault, True)
        self.silent_s.setdefault(name, self.loop.now_s)

    @rule(name=st.sampled_from(INPUTS))
    def an_input_comes_back(self, name: str) -> None:
        self.loop.wires[name].mute = self.loop.wires[name].cut = False
        self.silent_s.pop(name, None)

    @rule(deaf=st.booleans(), mute=st.booleans(), loss_rate=st.sampled_from([0.0, 0.1]))
    def the_planners_wire_changes(self, deaf: bool, mute: bool, loss_rate: float) -> None:
        planner = self.loop.planner
        planner.deaf, planner.mute, planner.loss_rate = deaf, mute, loss_rate

    @rule()
    def the_planner_starts_anew(self) -> None:
        self.loop.planner.greet()

    @rule(v_mps=st.sampled_from([0.0, 0.4, -0.3, 9.0]), w_radps=st.sampled_from([0.0, 0.5]))
    def the_planner_drives(self, v_mps: float, w_radps: float) -> None:
        for _ in range(4):
            self.asked_s = self.loop.now_s
            self.loop.planner.drive(self.loop.now_s, v_mps, w_radps, VALID_S)
            self.loop.run(0.1, self.check_stands)

    @rule()
    def somebody_knows_the_pose(self) -> None:
        x_m, y_m, yaw_rad = self.loop.rig.world.pose()[:3]
        self.loop.planner.external_pose(
            self.loop.now_s, x_m, y_m, yaw_rad, sigma_x_m=0.05, sigma_y_m=0.05, sigma_yaw_rad=0.05
        )

    @rule()
    def the_map_is_to_be_saved(self) -> None:
        with contextlib.suppress(StateError):  # no pose is known now
            assert state_of(self.loop.app.mapper, CONFIG, self.loop.now_s)

    @rule(seconds=st.sampled_from([0.005, 0.1, 0.5, 1.5]))
    def time_passes(self, seconds: float) -> None:
        self.loop.run(seconds, self.check_stands)

    def check_stands(self) -> None:
        """Nobody moves the wheels on stale inputs, or when nobody asks."""
        now_s = self.loop.now_s
        is_stale = any(now_s - since_s > STANDS_S for since_s in self.silent_s.values())
        if is_stale or now_s - self.asked_s > VALID_S + STANDS_S:
            assert self.loop.rig.drive.powers() == (0, 0)

    @invariant()
    def free_is_told_only_where_it_was_seen_lately(self) -> None:
        planner, now_s = self.loop.planner, self.loop.now_s
        is_free = planner.window() == 1
        if any(now_s - since_s > NOT_FREE_S for since_s in self.silent_s.values()):
            assert not is_free.any() or planner.stale(now_s) or planner.suspect
        if planner.geom is not None and planner.origin is not None:
            assert not any(planner.cell_at(*place_m) == 1 for place_m in IN_THE_BOX_M)

    @invariant()
    def every_frame_can_be_read(self) -> None:
        assert not self.loop.planner.rejected


TestAppLife = AppLife.TestCase
TestAppLife.settings = settings(
    max_examples=examples(3), stateful_step_count=14, phases=[Phase.generate]
)
