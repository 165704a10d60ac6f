"""What a scan costs in the maps alone, beside NumPy: `python -m tools.bench.mapping [SCENE]`.

One simulated drive at 50 Hz and 541 beams is recorded; its scans, with the attitude and the
odometry of their moment, are then taken by each method with maps of several sizes. Every fourth
scan NumPy does what it can of the same: cast, cells, lowest, highest and sum of each, states. Times
are of the CPU, medians; the ratio of both compares between machines, and busy hours of one.
Then a URG-04LX walks over rocks on the robot of robots/messor.toml, all of its beams used, and maps
cells of 10 mm; that time is with the shadow filter.
"""

import pickle
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from app import App, Ports
from config_file import load_config, with_changes
from core.config import Config
from core.mapping.mapper import Mapper
from core.mapping.shadows import ShadowFilter
from core.records import F64, Scan
from fakes.wires.wire import Fake, MemoryPort, Wire
from fakes.world.rig import Rig
from tools.bench.drive import FAST, SHIPPED
from tools.cli.options import ROBOTS
from tools.experiments.terrain import scenes
from tools.experiments.terrain.ride import WALKING, Ride
from tools.experiments.terrain.urg import Mount, Urg

SIZES = ((101, 0.2), (201, 0.2), (401, 0.2), (401, 0.05))
METHODS = ("surface", "reference_plane", "certainty")
SECONDS, SETTLED, PEER_EVERY = 16.0, 150, 4
START_S, DELAY_S = 1000.0, 2.0
SIDE_DEG, WALK_M, WALK_SEED = 120.0, (-1.0, 2.0), 1001  # of the beams; on the way over the rocks
FINE = {"cells": 200, "cell_m": 0.01}
FINE_METHODS = ("surface", "certainty")


def recorded(scene: str, config: Config, seconds: float = SECONDS) -> list[bytes]:
    """What the maps of an app are given on a drive: pickled, for odometry and attitude go on."""
    rig, taken = Rig(scene, 1, start_delay_s=DELAY_S), list[bytes]()
    ports = MemoryPort(), MemoryPort(), MemoryPort()
    planner = MemoryPort(datagrams=True)
    fakes: tuple[Fake, ...] = (rig.scanner, rig.ahrs, rig.drive)
    wires = [Wire(fake, ports[k], 1 + k) for k, fake in enumerate(fakes)]
    app = App(config, Ports(*ports, planner), session=1)
    add: Callable[..., int] = app.mapper.maps.add

    def note(*given: Any) -> int:
        taken.append(pickle.dumps(given))
        return add(*given)

    app.mapper.maps.add = note  # type: ignore[method-assign, assignment]
    for tick in range(round(seconds * config.loop.rate_hz)):
        now_s = START_S + tick / config.loop.rate_hz
        rig.step(now_s)
        for wire in wires:
            wire.step(now_s)
        app.step(now_s)
        planner.take_datagrams()
    return taken


class NumpyPeer:
    """The same insertion as far as NumPy does it without a loop; the maps have one fixed pose."""

    def __init__(self, cells: int, cell_m: float) -> None:
        self._size, self._cell_m = cells, cell_m
        self._low, self._high = np.full(cells * cells, np.inf), np.full(cells * cells, -np.inf)
        self._sum, self._states = np.zeros(cells * cells), np.zeros(cells * cells, np.int8)
        self._T = np.eye(4)

    def add(self, scan: Scan) -> None:
        ranges_m: F64 = scan.ranges_m[0]
        bearings = scan.first_rad + scan.step_rad * np.arange(ranges_m.size)
        rays = np.column_stack([np.cos(bearings), np.sin(bearings), np.zeros_like(bearings)])
        met = ranges_m >= 0.15
        points = (ranges_m[met, None] * rays[met]) @ self._T[:3, :3].T + self._T[:3, 3]
        i, j = (np.floor(points[:, :2] / self._cell_m).astype(np.int64) % self._size).T
        at = j * self._size + i
        np.minimum.at(self._low, at, points[:, 2])
        np.maximum.at(self._high, at, points[:, 2])
        np.add.at(self._sum, at, points[:, 2])
        touched = np.unique(at)
        stands = self._high[touched] - self._low[touched] > 0.1
        self._states[touched] = np.where(stands, 1, -1)


def measured(taken: list[bytes], config: Config) -> tuple[F64, F64]:
    """CPU seconds of each scan in the maps, and of NumPy."""
    maps, shadows = Mapper(config).maps, ShadowFilter(config)
    maps.warm()
    peer = NumpyPeer(config.map.cells, config.map.cell_m)
    spent_s, peer_s = [], []
    for k, given in enumerate(taken):
        scan, attitudes, odometry = pickle.loads(given)
        if k % PEER_EVERY == 0:
            begun_s = time.thread_time()
            peer.add(scan)
            peer_s.append(time.thread_time() - begun_s)
        begun_s = time.thread_time()
        maps.add(shadows.cleaned(scan), attitudes, odometry)
        spent_s.append(time.thread_time() - begun_s)
        maps.window.take_changed()
    return np.array(spent_s[SETTLED:]), np.array(peer_s[SETTLED // PEER_EVERY :])


def walked(config: Config) -> list[bytes]:
    """What the maps are given on a walk over rocks."""
    mount = Mount(config.scanner.mount_z_m, config.scanner.mount_tilt_deg)
    scene = scenes.scene("rocks", *scenes.rocks(WALK_SEED))
    ride = Ride(Urg(scene, mount, WALK_SEED, SIDE_DEG), WALK_M, WALKING, WALK_SEED)
    return [pickle.dumps((scan, ride.attitudes, ride.track)) for scan in ride.scans()]


def told(what: str, spent_s: F64, peer_s: F64) -> str:
    us, peer_us = 1e6 * float(np.median(spent_s)), 1e6 * float(np.median(peer_s))
    return f"{what}: {us:4.0f}; NumPy {peer_us:4.0f}; {us / peer_us:.2f} times"


def main(arguments: list[str]) -> int:
    scene = arguments[0] if arguments else "corridor"
    shipped = with_changes(load_config(SHIPPED.read_text(encoding="utf-8")), scanner=FAST)
    taken = recorded(scene, shipped)
    print(f"mapod: {len(taken)} scans of 541 beams in {scene}; us a scan, median")
    for method in METHODS:
        for cells, cell_m in SIZES:
            sizes = {"cells": cells, "cell_m": cell_m, "method": method}
            config = with_changes(shipped, map=sizes, obstacle={"window_cells": cells})
            spent_s, peer_s = measured(taken, config)
            print(told(f"{method:8} {cells} x {cells} cells of {cell_m:g} m", spent_s, peer_s))
    legs = load_config(ROBOTS["messor"].read_text(encoding="utf-8"))
    sides = {"from_deg": -SIDE_DEG, "to_deg": SIDE_DEG, "mount_x_m": 0.0}
    window = {"window_cells": FINE["cells"]}
    for method in FINE_METHODS:
        fine = {**FINE, "method": method}
        config = with_changes(legs, map=fine, obstacle=window, scanner=sides)
        taken = walked(config)
        scan = pickle.loads(taken[0])[0]
        what = f"{method:8} walking, {scan.ranges_m.size} beams, 200 x 200 cells of 0.01 m"
        print(told(what, *measured(taken, config)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
