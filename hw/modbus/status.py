"""The status block: what mapod is, how it is, where the robot is and what stands around it.

When nothing was published for STALE_S the block says so: no health bit that promises something, no
free way, mode "fault". Ages are those of the instant of reading.
"""

import math
from dataclasses import dataclass, replace

from core.records import PoseReport, StopZoneReport
from hw.modbus.encoding import (
    age_ms,
    bounded,
    cdeg_signed,
    distance_mm,
    heading_cdeg,
    mm_signed,
    thousandths_signed,
    way,
)
from hw.modbus.layout import (
    COARSE_CELLS,
    LAYOUT_VERSION,
    NOT_KNOWN,
    STATUS_BLOCK,
    WINDOW,
    WORD_ORDER_TEST,
    Value,
)
from hw.modbus.window import Snapshot

STALE_S = 1.0  # without a publication: nothing that was published is true any more
NEVER = float("-inf")

PROMISES = 0x007F  # bits of the link's health word that are good when set
COMPLAINTS = (1 << 8) | (1 << 9) | (1 << 15)  # dirty window, too steep, stop asked
POSE_VALID = 1 << 4  # of the link's health word
TRANSLATED = {0: 0, 1: 1, 2: 2, 4: 3, 5: 4}  # bit of the link's word: bit of register 21
PLANNER_HEARD, SETTINGS_RIGHT, ANY_FAULT = 1 << 5, 1 << 6, 1 << 15
FAULT, UNTRUSTED = 3, 8  # mode; cause of a stop zone
AGES = ("age_scan", "age_attitude", "age_encoders", "age_window", "age_pose")
QUALITY = {1: 100, 2: 50}  # by mode

NOWHERE = PoseReport(0, 0, 0, 0, 0, 0, 0, 0, math.inf, math.inf, math.inf, 0)
NOTHING_KNOWN = StopZoneReport(0, 0, 0, 0, 0, 0, 0, 0, 0, (0.0,) * 8, 0, UNTRUSTED)


@dataclass(frozen=True, slots=True)
class Published:
    """What the app said last."""

    at_s: float = NEVER
    generation: int = 0
    pose: PoseReport = NOWHERE
    zone: StopZoneReport = NOTHING_KNOWN
    planner_heard: bool = False
    sigma_m: float = math.inf
    sigma_rad: float = math.inf


def version_numbers(version: str) -> tuple[int, int]:
    """Two registers of a version text.

    >>> version_numbers("0.1.0"), version_numbers("2.13.4rc1"), version_numbers("")
    ((1, 0), (525, 4), (0, 0))
    """
    parts = [*version.split("."), "", "", ""][:3]
    digits = [int(part[: len(part) - len(part.lstrip("0123456789"))] or 0) for part in parts]
    return min(255, digits[0]) * 256 + min(255, digits[1]), min(NOT_KNOWN, digits[2])


def fault_count(word: int) -> int:
    """How many things the link's health word says are wrong."""
    return (PROMISES & ~word).bit_count() + (COMPLAINTS & word).bit_count()


def health_bits(word: int, planner_heard: bool) -> int:
    """Register 21 of the link's health word."""
    bits = sum(((word >> theirs) & 1) << ours for theirs, ours in TRANSLATED.items())
    bits |= PLANNER_HEARD if planner_heard else 0
    return bits | SETTINGS_RIGHT | (ANY_FAULT if fault_count(word) else 0)


class Status:
    """The status block of one run of mapod; packed anew when something was published."""

    def __init__(
        self, session: int, version: str, name: str, *, size: int, stride: int, cell_mm: int
    ) -> None:
        major_minor, patch = version_numbers(version)
        self._fixed: dict[str, Value] = {
            "magic": 0x4D50,
            "layout": LAYOUT_VERSION,
            "version_major_minor": major_minor,
            "version_patch": patch,
            "instance": session % 2**32,
            "name": name.encode("ascii", "replace")[:16],
            "uptime": 0,
            "word_order_test": WORD_ORDER_TEST,
            "utc": 0,
            "heartbeat": 0,
            "cell": cell_mm,
            "window_cells": size,
            "window_stride": stride,
            "window_first": WINDOW,
            "window_registers": size * stride,
            "coarse_cells": COARSE_CELLS,
        }
        self._started_s = math.inf  # of the first publication
        self._packed = bytearray()
        self._packed_of: tuple[int, int, bool] | None = None  # generations, stale

    def pack(
        self, now_s: float, utc_s: float, said: Published, map_: Snapshot, coarse_cell_mm: int
    ) -> bytes:
        """The whole block as it is now."""
        stale = not now_s - said.at_s <= STALE_S
        key = (said.generation, map_.generation, stale)
        if key != self._packed_of:
            values = _stale_values(said) if stale else _values(said)
            values |= self._fixed | _map_values(map_, coarse_cell_mm)
            self._packed, self._packed_of = bytearray(STATUS_BLOCK.pack(values)), key
        self._started_s = min(self._started_s, said.at_s if said.generation else now_s)
        for name, value in self._live(now_s, utc_s, said, map_).items():
            STATUS_BLOCK.put(self._packed, name, value)
        return bytes(self._packed)

    def _live(
        self, now_s: float, utc_s: float, said: Published, map_: Snapshot
    ) -> dict[str, Value]:
        """What goes on between two publications."""
        pose, since_s = said.pose, now_s - said.at_s
        has_pose = bool(pose.health & POSE_VALID)
        return {
            "uptime": int(max(0.0, now_s - self._started_s)) % 2**32,
            "utc": int(max(0.0, utc_s)) % 2**32,
            # of the last publication: it stands still when mapod does
            "heartbeat": int(max(0.0, said.at_s - self._started_s)) % 2**16,
            "age_scan": age_ms(pose.age_scan_s + since_s),
            "age_attitude": age_ms(pose.age_ahrs_s + since_s),
            "age_encoders": age_ms(pose.age_enc_s + since_s),
            "age_window": age_ms(now_s - map_.scan_s),
            "age_pose": age_ms(since_s) if has_pose else NOT_KNOWN,
        }


def _stale_values(said: Published) -> dict[str, Value]:
    """Nothing was published yet, or too long ago: no promise, no free way, no speed."""
    word = said.pose.health & ~PROMISES
    mode = FAULT if said.generation else 0
    nothing = replace(NOWHERE, health=word, mode=mode)
    return _values(Published(pose=nothing)) | {"health": ANY_FAULT}


def _values(said: Published) -> dict[str, Value]:
    """The entries that only a publication changes; ages come later."""
    pose, zone, word = said.pose, said.zone, said.pose.health
    values: dict[str, Value] = dict.fromkeys(AGES, NOT_KNOWN)
    values |= {f"sector_{k}": distance_mm(zone.sectors_m[k]) for k in range(8)}
    values |= {
        "generation": said.generation,
        "generation_again": said.generation,
        "generation_end": said.generation,
        "health": health_bits(word, said.planner_heard),
        "x": mm_signed(pose.x_m),
        "y": mm_signed(pose.y_m),
        "heading": heading_cdeg(pose.yaw_rad),
        "quality": QUALITY.get(pose.mode, 0) if word & POSE_VALID else 0,
        "sigma_position": distance_mm(said.sigma_m),
        "sigma_heading": _sigma_cdeg(said.sigma_rad),
        "speed": thousandths_signed(pose.v_mps),
        "turn": cdeg_signed(pose.w_radps),
        "pitch": cdeg_signed(pose.pitch_rad),
        "roll": cdeg_signed(pose.roll_rad),
        "faults": fault_count(word),
        "link_health": word % 2**16,
        "mode": pose.mode,
    }
    return values | _zone_values(zone)


def _zone_values(zone: StopZoneReport) -> dict[str, Value]:
    return {
        "stop_zone": zone.state,
        "nearest": distance_mm(zone.nearest_m),
        "bearing": cdeg_signed(zone.bearing_rad),
        "zone_causes": zone.causes,
        "free_ahead": way(zone.free_ahead_m),
        "obstacle_ahead": distance_mm(zone.obstacle_ahead_m),
        "free_behind": way(zone.free_behind_m),
        "obstacle_behind": distance_mm(zone.obstacle_behind_m),
        "contact": distance_mm(zone.contact_s),
        "allowed_ahead": way(zone.allowed_ahead_mps),
        "allowed_behind": way(zone.allowed_behind_mps),
    }


def _map_values(map_: Snapshot, coarse_cell_mm: int) -> dict[str, Value]:
    return {
        "window_x": map_.x_mm,
        "window_y": map_.y_mm,
        "window_generation": map_.generation,
        "coarse_cell": coarse_cell_mm,
    }


def _sigma_cdeg(radians: float) -> int:
    """Standard deviation of the heading; 65535 where it is not known."""
    return bounded(math.degrees(radians) * 100.0, 0, NOT_KNOWN) if radians >= 0 else NOT_KNOWN
