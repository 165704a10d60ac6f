"""How well the motion part alone follows simulated drives, over many sensors.

    python -m tools.rig.motion FOLDER --seed 5100 --sensors 6
    python -m tools.rig.motion FOLDER --seed 5100 --sensor jitter --only door

The drives are recorded once into the folder, which takes minutes. Then each sensor's errors are
drawn anew, attitudes and counts go through filter and odometry, and what they tell is held against
the truth. NEES: squared error over its variance, in the mean 1 where the covariance is right.
"""

import argparse
import math
import random
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from config_file import load_config
from core.config import Config
from core.geometry import wrapped
from core.motion.attitude import AttitudeRing
from core.motion.error_state import TILT, YAW
from core.motion.odometry import Odometry
from core.records import F64, Attitude
from tools.rig.runs.loop import SHIPPED
from tools.rig.runs.motion_drives import HZ, SENSORS, Drive, carried, drive_of, names

SETTLED_S = 3.0  # from then on errors count
EVERY = 50  # samples between two looks at the covariance


@dataclass(frozen=True, slots=True)
class Found:
    """One sensor on one drive; angles in degrees, (n,) from SETTLED_S on."""

    roll: F64
    pitch: F64
    yaw: F64
    yaw_nees: float
    tilt_nees: float
    disturbed: int
    doubted: int


def followed(
    drive: Drive, said: Sequence[Attitude], config: Config
) -> Iterator[tuple[int, AttitudeRing, Odometry]]:
    """Filter and odometry after each sample."""
    robot, ring = config.robot, AttitudeRing(0.0, 0.0, 0.0, levels=True)
    wheel = robot.wheel_radius_m, robot.encoder_ppr, robot.gear_ratio, robot.track_width_m
    odometry, counts, at = Odometry(ring, *wheel), drive.wheel_counts(), 0
    for k, attitude in enumerate(said):
        ring.add(attitude)
        while at < len(counts) and counts[at].t_s <= attitude.t_s:
            odometry.add(counts[at])
            odometry.settle()
            at += 1
        yield k, ring, odometry


def judged(drive: Drive, said: Sequence[Attitude], config: Config) -> Found:
    errors, yaw_nees, tilt_nees = [], [], []
    for k, ring, odometry in followed(drive, said, config):
        if k < SETTLED_S * HZ or not odometry.started:
            continue
        roll, pitch, yaw = ring.newest_rpy()
        off = roll - drive.pose[k, 4], pitch - drive.pose[k, 3]
        off_yaw = wrapped(yaw - odometry.yaw_start_rad - drive.pose[k, 2])
        errors.append((*off, off_yaw))
        if k % EVERY:
            continue
        state, c, s = ring.orientation.state, math.cos(yaw), math.sin(yaw)
        tilt = np.array([c * off[0] - s * off[1], s * off[0] + c * off[1]])
        P = state.P[TILT : TILT + 2, TILT : TILT + 2]
        tilt_nees.append(float(tilt @ np.linalg.solve(P, tilt)) / 2)
        yaw_nees.append((off_yaw + float(state.value[YAW])) ** 2 / float(state.P[YAW, YAW]))
    roll_deg, pitch_deg, yaw_deg = np.degrees(errors).T
    of = ring.orientation
    nees = float(np.mean(yaw_nees)), float(np.mean(tilt_nees))
    return Found(roll_deg, pitch_deg, yaw_deg, *nees, of.disturbed, of.doubted)


def row(found: Sequence[Found]) -> list[str]:
    """Root mean squares and largest errors of some, in words."""

    def rms(parts: Sequence[F64]) -> str:
        return f"{math.sqrt(np.mean([np.mean(part**2) for part in parts])):.2f}"

    yaws, rolls, pitches = ([getattr(f, n) for f in found] for n in ("yaw", "roll", "pitch"))
    return [
        str(len(found)), rms(rolls), rms(pitches), rms(yaws),
        f"{max(np.abs(part).max() for part in yaws):.2f}",
        f"{np.mean([f.yaw_nees for f in found]):.2f}",
        f"{np.mean([f.tilt_nees for f in found]):.2f}",
        str(sum(f.disturbed for f in found)), str(sum(f.doubted for f in found)),
    ]  # fmt: skip


def main(arguments: Sequence[str]) -> int:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        prog="python -m tools.rig.motion", description=__doc__, formatter_class=raw
    )
    parser.add_argument("folder", type=Path, help="for the drives")
    parser.add_argument("--seed", type=int, default=1, help="of the drives (1)")
    parser.add_argument("--sensors", type=int, default=6, help="how many on each drive (6)")
    parser.add_argument("--sensor", choices=list(SENSORS), default="sheet", help="(sheet)")
    parser.add_argument("--limit", type=float, default=200.0, help="seconds of a campaign's run")
    parser.add_argument("--only", nargs="*", choices=names(), help="these drives")
    options = parser.parse_args(arguments)
    config = load_config(SHIPPED.read_text(encoding="utf-8"))
    table, every = Table(box=box.MARKDOWN, header_style="bold"), []
    for column in ("drive", "sensors", "roll rms", "pitch rms", "yaw rms", "yaw most", "yaw NEES",
                   "tilt NEES", "disturbed", "doubted"):  # fmt: skip
        table.add_column(column, justify="left" if column == "drive" else "right")
    for name in options.only or names():
        drive = drive_of(name, options.seed, options.limit, options.folder, config)
        chance = random.Random(f"sensors {options.seed} {name}")  # each drive has its own
        found = [
            judged(drive, carried(drive, seed, SENSORS[options.sensor]()), config)
            for seed in chance.sample(range(10**6), options.sensors)
        ]
        table.add_row(name, *row(found))
        every += found
    table.add_row("all", *row(every))
    Console(width=120).print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
