"""What an app hears and works out while a recording is played to it, handed to who collects it.

Everything comes from the replay: the scans, angles and counts as the app decoded them, and the
poses and maps that it made of them.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from core.config import Config
from core.mapping.layers import LayerView
from core.mapping.mapper import Mapper
from core.mapping.method import Maps
from core.mapping.rays import BeamGeometry
from core.motion.attitude import AttitudeRing
from core.motion.track import Track
from core.records import F64, FREE, Attitude, PointSweep, PoseReport, Scan, WheelCounts
from tools.export.tables import TABLES, TIMES, Columns, Tables
from tools.replay.player import Player

STATE_PERIOD_S = 0.02  # between two rows of pose and health
Points = Callable[[float, F64], None]  # takes the instant and the places (n, 3) of a mapped sweep


class ListeningMapper:
    """A mapper, and somebody who hears what it is given."""

    def __init__(self, mapper: Mapper, tables: Tables, utc_offset_s: float) -> None:
        self._mapper, self._tables, self._utc_offset_s = mapper, tables, utc_offset_s

    def __getattr__(self, name: str) -> Any:
        return getattr(self._mapper, name)

    def add_attitude(self, attitude: Attitude) -> None:
        w, x, y, z = attitude.q_earth_sensor
        rates = dict(zip("xyz", attitude.rate_radps, strict=True))
        row = {"q_w": w, "q_x": x, "q_y": y, "q_z": z}
        row |= {f"rate_{axis}_radps": rate for axis, rate in rates.items()}
        self.row("attitude", attitude.t_s, **row)
        self._mapper.add_attitude(attitude)

    def add_counts(self, counts: WheelCounts) -> None:
        sides = {"left_counts": counts.left, "right_counts": counts.right}
        told = {"restarts": counts.restarts, "unpowered_s": counts.unpowered_s}
        self.row("wheels", counts.t_s, **sides, **told)
        self._mapper.add_counts(counts)

    def add_scan(self, scan: Scan | PointSweep) -> None:
        columns = columns_of(scan)
        self._tables.add("scans", columns | {"utc_ns": self._utc_ns(columns["t_s"])})
        self._mapper.add_scan(scan)

    def row(self, table: str, t_s: float, **values: float) -> None:
        """One row of a table."""
        columns = {name: np.array([value]) for name, value in values.items()}
        times = np.array([t_s])
        self._tables.add(table, columns | {"t_s": times, "utc_ns": self._utc_ns(times)})

    def _utc_ns(self, t_s: F64) -> npt.NDArray[np.int64]:
        return np.round((t_s + self._utc_offset_s) * 1e9).astype(np.int64)


def columns_of(scan: Scan | PointSweep) -> Columns:
    """A row for each measured range of a sweep, beam by beam."""
    echoes, beams = scan.ranges_m.shape
    if isinstance(scan, Scan):
        bearings = scan.first_rad + np.arange(beams) * scan.step_rad
        elevations, times_s = np.zeros(beams), scan.t_s + np.arange(beams) * scan.beam_dt_s
    else:
        x, y, z = scan.directions.T
        bearings, elevations = np.arctan2(y, x), np.arcsin(np.clip(z, -1.0, 1.0))
        times_s = scan.times_s
    beam, echo = (axis.ravel() for axis in np.meshgrid(range(beams), range(echoes), indexing="ij"))
    ranges_m = scan.ranges_m.T.ravel()
    known = np.isfinite(ranges_m)
    beam, echo = beam[known], echo[known]
    return {
        "t_s": times_s[beam],
        "counter": np.full(beam.size, scan.counter),
        "beam": beam,
        "echo": echo,
        "bearing_rad": bearings[beam],
        "elevation_rad": elevations[beam],
        "range_m": ranges_m[known],
    }


class ListeningMaps:
    """Maps, and somebody who hears where the returns of each sweep are."""

    def __init__(self, maps: Maps, config: Config, take: Points) -> None:
        self._maps, self._take = maps, take
        self._geometry = BeamGeometry.of(config.scanner)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._maps, name)

    def add(self, scan: Scan | PointSweep, attitudes: AttitudeRing, odometry: Track) -> int:
        sweep = self._geometry.cast(scan, attitudes, odometry)
        self._take(sweep.t_s, sweep.points())
        return self._maps.add(scan, attitudes, odometry)


def collect_tables(
    player: Player, steps: Iterable[float], tables: Tables, utc_offset_s: float
) -> None:
    """Play these steps of the recording, and write down what the app hears and says."""
    app = player.app
    listening = ListeningMapper(app.mapper, tables, utc_offset_s)
    app.mapper = cast(Mapper, listening)
    told_s = -math.inf
    for now_s in steps:
        if now_s - told_s < STATE_PERIOD_S:
            continue
        told_s = now_s
        _, pose = app.report(told_s)
        listening.row("health", told_s, **_values(pose, "health"))
        if app.mapper.maybe_pose(told_s) is not None:
            listening.row("pose", told_s, **_values(pose, "pose"))


def _values(pose: PoseReport, table: str) -> dict[str, float]:
    """Those fields of a report that the table has."""
    return {name: getattr(pose, name) for name in TABLES[table].keys() - TIMES.keys()}


def collect_points(player: Player, steps: Iterable[float], take: Points) -> None:
    """Play these steps, and hand over the returns of each sweep that is mapped."""
    mapper = player.app.mapper
    mapper.maps = cast(Maps, ListeningMaps(mapper.maps, player.config, take))
    for _ in steps:
        pass


def trusted_layer(player: Player, name: str) -> LayerView | None:
    """A layer of the map as it is now; in "state" nothing is free while it is not trusted."""
    view = player.app.mapper.maybe_layer(name)
    if view is None or name != "state":
        return view
    trusted, _ = player.app.report(player.now_s)
    if not trusted:
        view.values[view.values == FREE] = np.nan
    return view
