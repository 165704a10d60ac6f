"""A robot with a camera and a laser line: its map is true, and what it can't see it tells."""

from typing import Any

import numpy as np
import pytest

from app import App, Ports
from config_file import load_config, with_changes
from core.config import ConfigError
from core.map_settings import Method
from core.records import FREE, OBSTACLE
from fakes.scenes.scene import Scene, Solid
from fakes.stripe.device import FakeStripe
from tests import ROOT
from tests.support.cases import few
from tests.support.robot.closed_loop import ClosedLoop, told_heights
from tests.support.robot.shipped import FLOOR
from tools.rig.runs.loop import SESSION

pytest.importorskip("cv2", reason="needs OpenCV: pip install 'mapod[camera]'")
RAGNO = load_config((ROOT / "robots" / "ragno.toml").read_text(encoding="utf-8"))
SCANNER_FRESH = 1 << 0  # of the health word
PAUSE_S = 0.25
LOW = Solid("low", (1.51, 1.71), (-0.24, -0.04), (0.0, 0.06))
HIGH = Solid("high", (1.51, 1.71), (0.06, 0.26), (0.0, 0.10))


class Redialled:
    """The app's port as TCP has it: it can be dropped, and is dialled again after a while."""

    silence_s = 2.5

    def __init__(self, port: Any, wire: Any) -> None:
        self._port, self._wire = port, wire
        self._since_s: float | None = None
        self._is_dropped = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._port, name)

    def reopen(self, cause: str) -> None:
        self._port.connected, self._is_dropped, self._since_s = False, True, None
        self._port.cause = cause

    def poll(self, now_s: float) -> bool:
        if self._is_dropped:
            self._since_s = now_s if self._since_s is None else self._since_s
            if now_s - self._since_s > PAUSE_S and not self._wire.cut:
                self._port.connected, self._is_dropped = True, False
        return bool(self._port.poll(now_s))


class StripeLoop(ClosedLoop):
    """The robot of robots/ragno.toml in a hall with these."""

    def __init__(self, *solids: Solid, config: Any = RAGNO, **scene: Any) -> None:
        super().__init__(config, Scene("hall", (FLOOR, *solids), **scene), drives=bool(scene))
        assert isinstance(self.rig.scanner, FakeStripe)
        self.fake: FakeStripe = self.rig.scanner

    def _new_app(self, key: bytes | None) -> App:
        scanner, ahrs, drive = self.ports.values()
        port: Any = Redialled(scanner, self.wires["scanner"])
        return App(self.config, Ports(port, ahrs, drive, self.link_port), session=SESSION, key=key)

    def set(self, **attributes: Any) -> None:
        for name, value in attributes.items():
            setattr(self.fake, name, value)

    @property
    def scanner(self) -> Any:
        return self.app.devices.scanner

    @property
    def free(self) -> int:
        return int((self.planner.window() == 1).sum())

    def is_seeing(self) -> bool:
        pose = self.planner.pose
        is_fresh = pose is not None and pose.mode == 1 and bool(pose.health & SCANNER_FRESH)
        return is_fresh and self.free > 5


def begun() -> StripeLoop:
    loop = StripeLoop()
    loop.run(3.0)
    assert loop.is_seeing()
    assert loop.scanner.status.rejected == 0
    return loop


def test_certainty_takes_no_line_that_runs_up_the_image() -> None:
    up = {"along": "rows", "baseline_m": 0.12}
    assert with_changes(RAGNO, scanner=up).scanner.options.spec.light_normal is None
    with pytest.raises(ConfigError, match="one plane across its way, and 'stripe' as set has none"):
        with_changes(RAGNO, scanner=up, map={"method": "certainty"})


@pytest.mark.slow
@pytest.mark.parametrize("method", ["surface", "certainty"])
def test_heights_of_boxes_that_the_line_passes_over_are_true_to_five_millimetres(
    method: Method,
) -> None:
    ahead: dict[str, Any] = {"mount_x_m": 0.40}  # it must not run into them
    config = with_changes(RAGNO, scanner=ahead, map={"method": method})
    way: dict[str, Any] = {"waypoints": ((0.95, 0.0),), "speed_mps": 0.2}
    loop = StripeLoop(LOW, HIGH, config=config, **way)
    loop.set(mount_m=(0.40, 0.0, 0.40))
    loop.run(8.3)
    assert 0.9 < loop.rig.world.pose()[0] < 0.97
    maps = loop.app.mapper.maps
    grid, states = maps.window.grid, loop.map_now()
    heights_m = told_heights(maps)  # type: ignore[arg-type]
    x_m = (grid.corner_i + np.arange(grid.size)) * grid.cell_m
    y_m = (grid.corner_j + np.arange(grid.size)) * grid.cell_m
    for box in (LOW, HIGH):
        columns = (x_m >= box.x[0]) & (x_m + grid.cell_m <= box.x[1])
        rows = (y_m >= box.y[0]) & (y_m + grid.cell_m <= box.y[1])
        on_box = heights_m[np.ix_(rows, columns)]
        assert on_box.size >= 9
        assert np.abs(on_box - box.z[1]).max() < 0.005
        assert (states[np.ix_(rows, columns)] == OBSTACLE).all()
    before = heights_m[np.ix_(np.abs(y_m) < 0.2, (x_m > 0.95) & (x_m < 1.4))]
    assert np.abs(before).max() < 0.005
    assert (states == FREE).sum() > 120  # `certainty` frees nothing beside the boxes
    assert loop.scanner.status.rejected == 0


@pytest.mark.slow
def test_of_a_hundred_images_a_second_none_is_lost() -> None:
    config = with_changes(RAGNO, scanner={"rate_hz": 100.0})
    loop = StripeLoop(config=config)
    loop.set(rate_hz=100.0)
    loop.run(1.0)
    counts = loop.app.mapper.counts
    before = counts.scans_added, counts.scans_dropped
    loop.run(3.0)
    assert counts.scans_added - before[0] == pytest.approx(300, abs=2)
    assert counts.scans_dropped == before[1]  # all of them until attitudes had come
    assert loop.scanner.measured()["images_passed_over"] == 0
    assert loop.scanner.status.rejected == 0
    assert loop.planner.pose is not None
    assert loop.planner.pose.health & SCANNER_FRESH


FAULTS: list[tuple[dict[str, Any], str]] = [
    ({"truncated_rate": 1.0}, "a JPEG without its end"),
    ({"image_px": (320, 240)}, "the camera's images are 320 x 240 px"),
    ({"frozen": True}, "the same image again: the camera's picture stands still"),
    ({"late_s": 0.5}, "an image that comes 0.5"),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "told"),
    few(FAULTS, 1),
    ids=lambda value: "" if isinstance(value, str) else next(iter(value)),
)
def test_bad_images_are_counted_take_free_back_and_are_told(
    fault: dict[str, Any], told: str
) -> None:
    loop = begun()
    usual = {name: getattr(loop.fake, name) for name in fault}
    loop.set(**fault)
    loop.run(1.0)
    added = loop.app.mapper.counts.scans_added
    assert loop.planner.pose is not None
    assert not loop.planner.pose.health & SCANNER_FRESH
    loop.run(0.5)
    assert loop.free == 0
    assert loop.scanner.status.rejected > 25
    loop.run(1.0)
    assert loop.app.mapper.counts.scans_added == added
    assert loop.scanner.status.state == "starting"
    assert told in loop.scanner.status.cause
    loop.set(**usual)
    loop.run(6.0)
    assert loop.scanner.status.state == "running"
    assert loop.is_seeing()


@pytest.mark.slow
@pytest.mark.parametrize("is_unplugged", [True, False])
def test_a_camera_that_vanishes_takes_free_back_and_is_seen_again(is_unplugged: bool) -> None:
    loop = begun()
    wire = loop.wires["scanner"]
    loop.fake.gone, wire.cut = is_unplugged, not is_unplugged
    loop.run(1.5)
    assert loop.free == 0
    loop.run(2.5)
    status = loop.scanner.status
    assert (status.state == "closed") == (not is_unplugged)
    assert not is_unplugged or "'503 Service Unavailable'" in status.cause
    assert status.losses == 1
    loop.fake.gone = wire.cut = False
    loop.run(4.0)
    assert status.state == "running"
    assert loop.is_seeing()


@pytest.mark.slow
def test_torn_images_invent_no_line() -> None:
    loop = StripeLoop(HIGH)
    loop.set(torn_rate=0.5)
    loop.run(4.0)
    maps = loop.app.mapper.maps
    heights_m = told_heights(maps)  # type: ignore[arg-type]
    seen = np.isfinite(heights_m)
    assert seen.sum() > 5
    assert np.abs(heights_m[seen]).max() < 0.01


@pytest.mark.slow
def test_in_the_sun_it_says_that_it_sees_no_line_and_nobody_may_drive_by_it() -> None:
    loop = begun()
    loop.set(ambient="sun")
    loop.run(1.5)
    assert loop.scanner.status.state == "running"
    assert "sees no line" in loop.scanner.doubt
    assert loop.free == 0
    assert loop.planner.pose is not None
    assert not loop.planner.pose.health & SCANNER_FRESH
    assert loop.scanner.measured()["line_share"] < 0.05
    loop.set(ambient="lamp")
    loop.run(3.0)
    assert loop.scanner.doubt == ""
    assert loop.is_seeing()


def test_the_fake_is_mounted_as_its_robots_settings_say() -> None:
    fake, scanner = StripeLoop().fake, RAGNO.scanner
    options = scanner.options
    assert fake.mount_m == scanner.mount_xyz_m
    assert fake.tilt_deg == scanner.mount_tilt_deg
    for name in ("rate_hz", "latency_s", "along", "colour", "line_px", "baseline_m", "laser_deg"):
        assert getattr(fake, name) == getattr(options, name), name
    for name in ("image_px", "focal_px", "centre_px", "distortion"):
        assert list(getattr(fake, name)) == list(getattr(options, name)), name
