"""The robot with a depth camera: its fake sees the same world, and all of the app is recorded."""

from pathlib import Path
from typing import Any

from app import App, Ports
from core.config import Config
from fakes.scenes.scene import Scene, Solid
from fakes.visionary.device import FakeVisionary
from fakes.wires.wire import MemoryPort, Wire
from recorder import Recorder
from recording.direct import DirectTap
from recording.tap import AnyTap
from tests.support.robot.closed_loop import SESSION, ClosedLoop
from tests.support.robot.recorded import ListTap
from tests.support.robot.shipped import FLOOR, shipped
from tools.rig.runs.loop import START_S
from wiring import DepthPorts

BY_FOUR = b"\x02"  # binningOption: few pixels, for short tests
KEYS: dict[str, Any] = {
    "driver": "visionary",
    "port": "tcp://192.168.1.10:2122",
    "control": "cola_2",
    "period_s": 0.1,
    "level": "authorized_client",
    "password": "CLIENT",
    "min_confidence": 6554,
    "latency_s": 0.03,
    "mount_x_m": 0.35,
    "mount_z_m": 0.7,
    "mount_tilt_deg": 25.0,
}


def with_camera(**sections: dict[str, Any]) -> Config:
    return shipped(depth=KEYS, **sections)


class DepthLoop(ClosedLoop):
    """World, fakes and app, stepped together; the camera's frames are looked at as they come."""

    def __init__(
        self,
        scene: Scene | str,
        config: Config | None = None,
        to: Path | type[ListTap] = ListTap,
        drives: bool = True,
    ) -> None:
        def clock() -> float:
            return self.now_s

        self.now_s, config = START_S, config or with_camera()
        self.tap: AnyTap = DirectTap(to, clock) if isinstance(to, Path) else to(clock)
        self.recorder = Recorder(config, "0.1", self.tap)
        self.depth_ports = MemoryPort(), MemoryPort()
        super().__init__(config, scene, drives=drives)
        depth = config.depth
        assert depth is not None
        self.camera = FakeVisionary("t_mini", self.rig.world.met, 1)
        self.camera.memory.written["binningOption"] = BY_FOUR
        self.camera.mount_m = depth.mount_xyz_m
        self.camera.tilt_deg = depth.mount_tilt_deg
        control, stream = self.depth_ports
        doors = (self.camera.control, control), (self.camera.stream, stream)
        self.depth_wires = [Wire(door, port, 5 + k) for k, (door, port) in enumerate(doors)]

    def _new_app(self, key: bytes | None) -> App:
        scanner, ahrs, drive = self.ports.values()
        control, stream = self.depth_ports
        depth = DepthPorts(control, lambda number: stream)
        ports = Ports(scanner, ahrs, drive, self.link_port, depth=depth)
        app = App(self.config, self.recorder.ports(ports), session=SESSION, key=key)
        return self.recorder.begin(app, key is not None, None)

    def _advance(self) -> None:
        super()._advance()
        for wire in self.depth_wires:
            wire.step(self.now_s)


def hall(*solids: Solid) -> Scene:
    return Scene("hall", (FLOOR, *solids))
