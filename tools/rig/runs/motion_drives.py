"""True motions of simulated drives, kept on disk, and what sensors with errors make of them.

A drive is a run of a campaign, or a way without physics, past steel or without any (`WAYS`). Kept
are the truth at 100 Hz and the wheels' counts as the app had them. Any number of attitude sensors
can then be carried along it, each with errors of its own: they hardly change how a robot drives.
"""

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from core.config import Config
from core.geometry import q_from_R
from core.records import F64, Attitude, WheelCounts
from fakes.mti.faults import Faults
from fakes.mti.memory import Memory
from fakes.mti.sensor import Sensor
from fakes.scenes.scene import campaign_scenes
from fakes.world.kinematic import KinematicWorld
from fakes.world.magnetic import MagneticDisturbance
from fakes.world.trajectory import Leg, Way, arc, stand, straight, turn
from tools.experiments.beyond_things import DOOR
from tools.experiments.scenes import corridor, scene
from tools.rig.runs.loop import START_S
from tools.rig.runs.one_run import Run, RunSpec

HZ, COUNTS_HZ = 100, 20
LEAD_S = 4.0  # standing at first
SENSORS: dict[str, Callable[[], Faults]] = {
    "sheet": lambda: Faults(sheet_errors=True),
    "plain": Faults,
    "jitter": lambda: Faults(sheet_errors=True, angle_noise_rad=0.06),
}


@dataclass(slots=True)
class Drive:
    """The truth of a drive: n samples, m pairs of counts."""

    t_s: F64  # (n,)
    q_earth_body: F64  # (n, 4)
    rate_radps: F64  # (n, 3) about body axes
    accel_mps2: F64  # (n, 3) with gravity
    pose: F64  # (n, 5) x, y, yaw, pitch, roll; map frame
    steel: F64  # (n, 3, 3) what steel makes of the earth's field
    counts: F64  # (m, 6) the fields of WheelCounts

    def wheel_counts(self) -> list[WheelCounts]:
        return [
            WheelCounts(t_s, left, right, int(restarts), unpowered_s, bool(cut_off))
            for t_s, left, right, restarts, unpowered_s, cut_off in self.counts.tolist()
        ]

    def save(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(path, **{part.name: getattr(self, part.name) for part in fields(self)})

    @staticmethod
    def load(path: Path) -> "Drive":
        with np.load(path) as found:
            return Drive(**{part.name: found[part.name] for part in fields(Drive)})


@dataclass(slots=True)
class Log:
    """Takes the truth of a world, sample by sample, and pairs of counts."""

    rows: list[tuple[Any, ...]] = field(default_factory=list)
    counts: list[tuple[float, ...]] = field(default_factory=list)

    def look(self, world: Any, now_s: float) -> None:
        R, rate, accel = world.motion_at(now_s)
        steel = world.distortion_at(now_s) if world.scene.steels else np.eye(3)
        self.rows.append((now_s, q_from_R(R), rate, accel, world.pose(now_s), steel))

    def note(self, counts: WheelCounts) -> None:
        self.counts.append(tuple(map(float, msgspec.structs.astuple(counts))))

    def drive(self) -> Drive:
        t_s, q, rates, accels, poses, steels = map(np.array, zip(*self.rows, strict=True))
        return Drive(t_s, q, rates, accels, poses, steels, np.array(self.counts))


def campaign_drive(name: str, seed: int, limit_s: float) -> Drive:
    """A run to the goals of a scene."""
    run, log = Run(RunSpec(name, seed, (), limit_s)), Log()
    odometry, every = run.loop.app.mapper.odometry, round(run.loop.config.loop.rate_hz / HZ)
    add = odometry.add

    def heard(counts: WheelCounts) -> None:
        log.note(counts)
        add(counts)

    def look(of: Run) -> None:
        if of.loop.ticks % every == 0:
            log.look(of.loop.rig.world, of.loop.now_s)

    odometry.add = heard  # type: ignore[method-assign]
    run.to_end(look)
    return log.drive()


def way_drive(way: Way, steels: tuple[MagneticDisturbance, ...], config: Config) -> Drive:
    """A way without physics, on a level floor."""
    world = KinematicWorld(replace(scene("corridor", corridor(28.37)), steels=steels), way)
    per_rad, log = 4 * config.robot.encoder_ppr * config.robot.gear_ratio / math.tau, Log()
    world.step_to(START_S)
    for k in range(1, round((way.duration_s + 1.0) * HZ)):
        now_s = START_S + k / HZ
        world.step_to(now_s)
        log.look(world, now_s)
        if k % (HZ // COUNTS_HZ) == 0:
            left, right = (math.floor(per_rad * angle) for angle in world.wheel_angles_rad())
            log.note(WheelCounts(now_s, left, right, 0))
    return log.drive()


def _steel_way(chance: random.Random) -> tuple[list[Leg], tuple[MagneticDisturbance, ...]]:
    """Curves and turns past two pieces of steel."""
    steels = tuple(
        MagneticDisturbance(
            f"steel {k}",
            (chance.uniform(4, 9), chance.uniform(-1.5, 1.5)),
            math.radians(chance.uniform(-60, 60)),
            chance.uniform(0.8, 2.5),
            chance.uniform(0.1, 0.5),
        )
        for k in range(2)
    )
    legs = [straight(chance.uniform(3, 6), chance.uniform(0.3, 0.9)), arc(3.0, 0.7, 0.5)]
    legs += [stand(chance.uniform(0, 5)), straight(3, 0.5), turn(chance.uniform(-3, 3), 0.6)]
    legs += [straight(4, 0.6), turn(chance.uniform(-3, 3), 0.6), straight(5, 0.8), stand(2)]
    return [*legs, straight(6, 0.7)], steels


def _winding_way(chance: random.Random) -> tuple[list[Leg], tuple[MagneticDisturbance, ...]]:
    """There and back at all speeds, and turns."""
    legs: list[Leg] = []
    for _ in range(12):
        sign = chance.choice([1, 1, -1])
        legs.append(straight(sign * chance.uniform(1, 5), chance.uniform(0.3, 1.0)))
        legs.append(turn(chance.uniform(-3, 3), 0.7))
    return legs, ()


WAYS: dict[str, Callable[[random.Random], tuple[list[Leg], tuple[MagneticDisturbance, ...]]]] = {
    "door": lambda chance: ([straight(12.0, 0.5)], (DOOR,)),
    "door-fast": lambda chance: ([straight(12.0, 1.0)], (DOOR,)),
    **{f"steel-{k}": _steel_way for k in range(4)},
    **{f"winding-{k}": _winding_way for k in range(2)},
}


def names() -> list[str]:
    return [*campaign_scenes(), *WAYS]


def drive_of(name: str, seed: int, limit_s: float, folder: Path, config: Config) -> Drive:
    """The drive of a scene or way, from the folder if it is there."""
    path = folder / f"{seed}-{name}.npz"
    if path.exists():
        return Drive.load(path)
    chance = random.Random(f"motion {seed} {name}")
    if name in WAYS:
        legs, steels = WAYS[name](chance)
        drive = way_drive(Way(stand(LEAD_S), *legs), steels, config)
    else:
        drive = campaign_drive(name, chance.randrange(1, 10**6), limit_s)
    drive.save(path)
    return drive


def carried(drive: Drive, seed: int, faults: Faults) -> list[Attitude]:
    """What a sensor of such a seed says along a drive."""
    rows, said = {t_s: k for k, t_s in enumerate(drive.t_s.tolist())}, []
    w, x, y, z = drive.q_earth_body.T
    R = np.empty((len(w), 3, 3))
    R[:, 0, 0], R[:, 0, 1], R[:, 0, 2] = (
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
    )  # fmt: skip
    R[:, 1, 0], R[:, 1, 1], R[:, 1, 2] = (
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    )  # fmt: skip
    R[:, 2, 0], R[:, 2, 1], R[:, 2, 2] = (
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip

    def motion_at(t_s: float) -> tuple[F64, F64, F64]:
        k = rows[t_s]
        return R[k], drive.rate_radps[k], drive.accel_mps2[k]

    if np.abs(drive.steel - np.eye(3)).max() > 0.0:
        faults.distortion_at = lambda t_s: drive.steel[rows[t_s]]
    sensor = Sensor(faults, Memory(), motion_at, seed)
    for t_s in rows:
        sample = sensor.sample(t_s)
        one, two, three, four = q_from_R(sample.R_earth_sensor).tolist()
        rates, field_ = sample.rate_radps.tolist(), sample.magnetic.tolist()
        said.append(Attitude(t_s, (one, two, three, four), tuple(rates), tuple(field_)))
    return said
