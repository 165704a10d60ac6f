"""Another scanner, sketched in an afternoon: two planes of 61 rays, ten times a second.

It is registered like any driver, its bytes go in at its port, and the planner gets its map.
"""

import math
import struct
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
import pytest

from core.config import ConfigError
from core.geometry import R_from_rpy
from core.records import F64, PointSweep, ScannerSpec
from fakes.scenes.scene import Scene
from hw.device import BadFrame, Device, DeviceStatus, Port, Session, Tick
from hw.registry import SCANNERS, Driver, Surroundings
from tests.support.robot.closed_loop import ClosedLoop
from tests.support.robot.shipped import FLOOR, shipped

HEAD = struct.Struct("<2sHH")  # "2P", counter, rays; then millimetres, u16 each
PLANES_RAD, FAN_RAD, RAYS = (0.0, math.radians(3.0)), math.radians(60.0), 122


class TwoPlaneOptions(msgspec.Struct, frozen=True):
    """The one key that this driver alone knows."""

    sweeps_hz: float

    @property
    def spec(self) -> ScannerSpec:
        bearings = np.linspace(-FAN_RAD, FAN_RAD, RAYS // 2)
        fans = [
            np.stack([np.cos(bearings), np.sin(bearings), 0 * bearings], 1)
            @ R_from_rpy(0.0, down_rad, 0.0).T
            for down_rad in PLANES_RAD
        ]
        return ScannerSpec(1 / self.sweeps_hz, RAYS, 12.0, 1, 0.012, 0.0, False, np.vstack(fans))

    def describe(self) -> str:
        return f"{RAYS} rays in two planes, {self.sweeps_hz:g} times a second"


class TwoPlaneParser:
    """Whole frames in; anything else is none."""

    def feed(self, now_s: float, data: bytes) -> list[Any]:
        if len(data) != HEAD.size + 2 * RAYS or data[:2] != b"2P":
            return [BadFrame("no frame of two planes", data)]
        _, counter, _ = HEAD.unpack_from(data)
        mm = np.frombuffer(data, "<u2", RAYS, HEAD.size).astype(np.float64)
        return [(counter, np.where(mm > 0, mm / 1000, np.nan))]


class TwoPlane(Device[PointSweep]):
    """It talks unasked, stamps nothing and has no doubts."""

    clock_locked, clock_uncertainty_s, is_impaired, doubt = True, 0.005, False, ""

    def __init__(self, port: Port, options: TwoPlaneOptions, around: Surroundings) -> None:
        self._spec = options.spec
        super().__init__(DeviceStatus("twoplane"), port, TwoPlaneParser, self._run)

    def _run(self) -> Session:
        while True:
            tick: Tick = yield b""
            if any(not isinstance(event, BadFrame) for event in tick.events):
                self.status.state, self.status.cause = "running", ""

    def _measure(self, now_s: float, events: list[Any]) -> list[PointSweep]:
        times_s, origins = np.full(RAYS, now_s), np.zeros((RAYS, 3))
        return [
            PointSweep(origins, self._spec.directions, event[1][None], times_s, event[0], now_s)
            for event in events
            if not isinstance(event, BadFrame)
        ]


WALL_M, KEYS = 6.1, {"driver": "twoplane", "sweeps_hz": 10.0}


@pytest.fixture
def registered() -> Iterator[None]:
    SCANNERS["twoplane"] = Driver(TwoPlaneOptions, TwoPlane)
    yield
    del SCANNERS["twoplane"]


def seen_mm(directions: F64) -> bytes:
    """What it measures of a floor, and of a wall that ends to the left, before a robot at rest."""
    rays = directions @ R_from_rpy(0.0, math.radians(7.5), 0.0).T
    to_floor, to_wall = 1.08 / np.maximum(1e-9, -rays[:, 2]), (WALL_M - 0.25) / rays[:, 0]
    is_wall = (to_wall < to_floor) & (to_wall * rays[:, 1] < 0.5)
    ranges_m = np.where(is_wall, to_wall, to_floor)
    return np.where(ranges_m < 12.0, 1000 * ranges_m, 0).round().astype("<u2").tobytes()


@pytest.mark.usefixtures("registered")
def test_a_scanner_from_the_registry_drives_the_app_from_its_bytes_to_the_planners_map() -> None:
    config = shipped(scanner=KEYS)
    loop = ClosedLoop(config, Scene("hall", (FLOOR,)), drives=False)
    scan = seen_mm(config.scanner.options.spec.directions)
    for k in range(40):
        loop.run(0.1)
        loop.ports["scanner"].give(HEAD.pack(b"2P", k, RAYS) + scan)
    loop.run(0.15)  # longer than an LMS1xx may be silent
    assert loop.app.devices.scanner.status.state == "running"
    assert loop.app.mapper.counts.scans_added > 25
    assert loop.planner.origin is not None
    places = (6.1, -0.5), (8.5, 3.0), (6.1, 3.0), (3.0, 0.0)
    assert [loop.planner.cell_at(*place) for place in places] == [2, 1, 1, 0]
    assert loop.planner.pose is not None
    assert loop.planner.pose.mode == 1
    loop.run(0.2)  # three of its periods
    assert loop.planner.pose.mode == 3
    assert not (loop.planner.window() == 1).any()


@pytest.mark.usefixtures("registered")
def test_its_keys_are_its_own_and_more_rays_than_it_has_reach_no_kernel() -> None:
    with pytest.raises(ConfigError, match="echo: unknown key for driver 'twoplane'; allowed"):
        shipped(scanner={**KEYS, "echo": "first"})
    with pytest.raises(ConfigError, match=r"reference_plane.* needs a scanner of one plane"):
        shipped(scanner=KEYS, map={"method": "reference_plane"})
    with pytest.raises(
        ConfigError, match=r"certainty.* returns all lie in one plane across its way"
    ):
        shipped(scanner=KEYS, map={"method": "certainty"})
    loop = ClosedLoop(shipped(scanner=KEYS), Scene("hall", (FLOOR,)), drives=False)
    nowhere = np.zeros((2000, 3))
    many = PointSweep(nowhere, nowhere, np.ones((1, 2000)), np.zeros(2000), 0, 0.0)
    with pytest.raises(ValueError, match="1 to 122 beams, this one 1 x 2000"):
        loop.app.mapper.add_scan(many)
