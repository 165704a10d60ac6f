"""What an attitude sample costs from its bytes to the pose: `python -m tools.bench.samples`.

A minute of a drive is recorded once: what the line of a fake MTi brings between two looks of 5 ms,
half a frame or so, and what the wheels count. Then each part is run on it alone: computing only,
the best of several rounds.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from app import Ports
from config_file import load_config
from core.config import Config
from core.mapping.mapper import Mapper
from core.records import Attitude, WheelCounts
from fakes.wires.wire import MemoryPort, Wire
from fakes.world.rig import Rig
from hw.device import NoPort
from tools.bench.drive import SCENE, SEED, SHIPPED, START_S
from wiring import Devices, devices_on

SECONDS, LOOK_S = 60.0, 0.005
ROUNDS = 7


@dataclass(slots=True)
class Recording:
    """Of each look its time and the bytes there were; then what they said."""

    looks: list[tuple[float, list[bytes]]] = field(default_factory=list)
    attitudes: list[Attitude] = field(default_factory=list)
    counts: list[WheelCounts] = field(default_factory=list)


def devices(config: Config, ahrs: MemoryPort, drive: MemoryPort) -> Devices:
    return devices_on(Ports(NoPort(), ahrs, drive, NoPort()), config)


def recorded(config: Config) -> Recording:
    rig, ahrs, drive = Rig(SCENE, SEED), MemoryPort(), MemoryPort()
    line = MemoryPort()  # between the fake and the port, so that its bytes are seen
    wires = [Wire(rig.ahrs, line, 2), Wire(rig.drive, drive, 3)]
    heard, found = devices(config, ahrs, drive), Recording()
    for look in range(round(SECONDS / LOOK_S)):
        now_s = START_S + look * LOOK_S
        rig.step(now_s)
        line.write(ahrs.take())
        for wire in wires:
            wire.step(now_s)
        pieces = line.read()
        for piece in pieces:
            ahrs.give(piece)
        found.looks.append((now_s, pieces))
        found.attitudes += heard.ahrs.step(now_s)
        found.counts += heard.drive.step(now_s)
    return found


def session_s(config: Config, of: Recording) -> float:
    """Bytes to attitudes: each piece heard as it comes, and a step at each look."""
    port = MemoryPort()
    ahrs, given = devices(config, port, MemoryPort()).ahrs, 0
    begun_s = time.process_time()
    for now_s, pieces in of.looks:
        for piece in pieces:
            port.give(piece)
            ahrs.hear(now_s)
        given += len(ahrs.step(now_s))
    spent_s = time.process_time() - begun_s
    if given != len(of.attitudes):
        raise ValueError(f"{given} samples of {len(of.attitudes)} came out")
    return spent_s


def attitudes_s(config: Config, of: Recording) -> float:
    """Attitudes into the filters."""
    mapper = Mapper(config)
    begun_s = time.process_time()
    for attitude in of.attitudes:
        mapper.add_attitude(attitude)
    return time.process_time() - begun_s


def motion_s(config: Config, of: Recording) -> float:
    """Attitudes and counts into filters and path, each pair laid with the attitude behind it."""
    mapper, counts = Mapper(config), iter([*of.counts, None])
    due = next(counts)
    begun_s = time.process_time()
    for attitude in of.attitudes:
        mapper.add_attitude(attitude)
        while due is not None and due.t_s <= attitude.t_s:
            mapper.add_counts(due)
            mapper.settle(attitude.t_s)
            due = next(counts)
    return time.process_time() - begun_s


def sample_costs() -> list[str]:
    """In words, for a person."""
    config = load_config(SHIPPED.read_text(encoding="utf-8"))
    of = recorded(config)

    def best_us(part: Callable[[Config, Recording], float]) -> float:
        return 1e6 * min(part(config, of) for _ in range(ROUNDS))

    samples, counts = len(of.attitudes), len(of.counts)
    filters_us = best_us(attitudes_s)
    return [
        f"MTi session, bytes to attitude{best_us(session_s) / samples:20.1f} us a sample",
        f"attitude into the filters{filters_us / samples:25.1f} us a sample",
        f"counts into the path{(best_us(motion_s) - filters_us) / counts:30.1f} us a pair",
    ]


if __name__ == "__main__":
    print("\n".join(sample_costs()))
    sys.exit(0)
