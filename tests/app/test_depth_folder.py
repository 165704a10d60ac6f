"""A data set of a simulated Kinect in the app: its floor and what stands there are in the map."""

from typing import Any

import pytest

from config_file import text_from
from core.config import Config
from core.records import FREE, OBSTACLE, UNKNOWN
from fakes.kinect.device import FakeKinect
from fakes.kinect.faults import Form
from fakes.kinect.sensing import Lens
from fakes.scenes.scene import Solid
from fakes.wires.wire import Wire
from tests.support.devices.bench_kinect import USUAL
from tests.support.robot.depth_loop import DepthLoop, hall
from tests.support.robot.shipped import shipped

BOX = Solid("box", (1.6, 2.0), (-0.3, 0.3), (0.0, 0.4))  # nearer than the laser meets the floor
SMALL = Lens((160, 120), (145.0, 145.0), (79.5, 59.5))
MOUNT = {"mount_x_m": 0.35, "mount_z_m": 0.7, "mount_tilt_deg": 25.0}


def config_of(**driver: Any) -> Config:
    return shipped(depth={**driver, **MOUNT}, objects={"noise_per_m2": 0.003})


class KinectLoop(DepthLoop):
    """The robot with such a camera instead."""

    def __init__(self, config: Config, form: Form, lens: Lens) -> None:
        super().__init__(hall(BOX), config, drives=False)
        fake, depth = FakeKinect(self.rig.world.met, 1, form, lens), config.depth
        assert depth is not None
        fake.mount_m, fake.tilt_deg = (depth.mount_x_m, 0.0, depth.mount_z_m), depth.mount_tilt_deg
        fake.period_s = 0.1  # as the settings of a folder say; of a Kinect it loses two of three
        self.kinect = fake
        self.depth_wires = [Wire(fake, self.depth_ports[0], 5)]

    def state_at(self, x_m: float, y_m: float) -> int:
        window = self.app.mapper.maps.window
        i, j = window.grid.cell_of(x_m, y_m)
        return int(window.cells[j % window.grid.size, i % window.grid.size])


@pytest.mark.slow
def test_a_folder_fills_the_near_field_and_takes_its_free_back_when_it_ends() -> None:
    config = config_of(driver="folder", port="folder:///home/robot/frames", period_s=0.1)
    loop = KinectLoop(config, "png", SMALL)
    loop.run(2.0)
    assert loop.app.devices.depth is not None
    assert loop.app.devices.depth.status.state == "running"
    assert loop.state_at(1.3, 0.0) == FREE
    assert loop.state_at(1.7, 0.1) == OBSTACLE
    assert text_from(config)
    loop.kinect.small = True  # images of another size
    loop.run(0.9)
    assert loop.state_at(1.3, 0.0) == UNKNOWN
    assert loop.state_at(1.7, 0.1) == OBSTACLE
    assert loop.app.devices.depth.status.rejected > 0
    loop.kinect.small = False
    loop.run(3.0)
    assert loop.state_at(1.3, 0.0) == FREE
    loop.kinect.mute = True
    loop.run(0.9)
    assert loop.state_at(1.3, 0.0) == UNKNOWN


@pytest.mark.slow
def test_a_kinects_raw_frames_fill_it_too() -> None:
    config = config_of(driver="kinect", port="kinect:///0?format=raw", **USUAL)
    loop = KinectLoop(config, "raw", Lens())
    loop.run(1.5)
    assert loop.state_at(1.3, 0.0) == FREE
    assert loop.state_at(1.7, 0.1) == OBSTACLE
