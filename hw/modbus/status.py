"""The status block: what mapod is, how it is, where the robot is and what stands around it.

When nothing was published for STALE_S the block says so: no health bit that promises something, no
free way, mode "fault". Ages are those of the instant of reading.
"""

import math
from dataclasses import dataclass

from msgspec.structs import replace

from core.records import PoseReport, StopZoneReport
from hw.modbus.layout import (
    COARSE_CELLS,
    LAYOUT_VERSION,
    NOT_KNOWN,
    STATUS_BLOCK,
    WINDOW,
    WORD_ORDER_TEST,
    Value,
    age_ms,
    cdeg_signed,
    distance_mm,
    heading_cdeg,
    mm_signed,
    or_worst,
    thousandths_signed,
    way,
)
from hw.modbus.window import Packer, Snapshot

STALE_S = 1.0  # without a publication: nothing that was published is true any more
NEVER = float("-inf")

PROMISES = 0x007F  # bits of the link's health word that are good when set
COMPLAINTS = (1 << 8) | (1 << 9) | (1 << 15)  # dirty window, too steep, stop asked
POSE_VALID = 1 << 4  # of the link's health word
TRANSLATED = {0: 0, 1: 1, 2: 2, 4: 3, 5: 4}  # bit of the link's word: bit of register 21
PLANNER_HEARD, SETTINGS_RIGHT, ANY_FAULT = 1 << 5, 1 << 6, 1 << 15
FAULT, UNTRUSTED = 3, 8  # mode; cause of a stop zone
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
    """The status block of one run of mapod."""

    def __init__(self, session: int, version: str, packer: Packer) -> None:
        major_minor, patch = version_numbers(version)
        self._fixed: dict[str, Value] = {
            "magic": 0x4D50,
            "layout": LAYOUT_VERSION,
            "version_major_minor": major_minor,
            "version_patch": patch,
            "instance": session % 2**32,
            "name": b"mapod",
            "word_order_test": WORD_ORDER_TEST,
            "cell": packer.cell_mm,
            "window_cells": packer.size,
            "window_stride": packer.stride,
            "window_first": WINDOW,
            "window_registers": packer.size * packer.stride,
            "coarse_cell": packer.coarse_cell_mm,
            "coarse_cells": COARSE_CELLS,
        }
        self._started_s = math.inf  # of the first publication

    def pack(self, now_s: float, utc_s: float, said: Published, newest: Snapshot) -> bytes:
        self._started_s = min(self._started_s, said.at_s if said.generation else now_s)
        is_fresh = now_s - said.at_s <= STALE_S
        values = _values(said) if is_fresh else _stale_values(said)
        values |= self._fixed | _ages(now_s, said, newest)
        values |= {
            "uptime": int(max(0.0, now_s - self._started_s)) % 2**32,
            "utc": int(max(0.0, utc_s)) % 2**32,
            # of the last publication: it stands still when mapod does
            "heartbeat": int(max(0.0, said.at_s - self._started_s)) % 2**16,
            "window_x": newest.x_mm,
            "window_y": newest.y_mm,
            "window_generation": newest.generation,
        }
        return STATUS_BLOCK.pack(values)


def _ages(now_s: float, said: Published, newest: Snapshot) -> dict[str, Value]:
    pose, since_s = said.pose, now_s - said.at_s
    return {
        "age_scan": age_ms(pose.age_scan_s + since_s),
        "age_attitude": age_ms(pose.age_ahrs_s + since_s),
        "age_encoders": age_ms(pose.age_enc_s + since_s),
        "age_window": age_ms(now_s - newest.scan_s),
        "age_pose": age_ms(since_s) if pose.health & POSE_VALID else NOT_KNOWN,
    }


def _stale_values(said: Published) -> dict[str, Value]:
    """Nothing was published yet, or too long ago: no promise, no free way, no speed."""
    word = said.pose.health & ~PROMISES
    mode = FAULT if said.generation else 0
    nothing = replace(NOWHERE, health=word, mode=mode)
    return _values(Published(pose=nothing)) | {"health": ANY_FAULT}


def _values(said: Published) -> dict[str, Value]:
    pose, zone, word = said.pose, said.zone, said.pose.health
    sectors = {f"sector_{k}": distance_mm(zone.sectors_m[k]) for k in range(8)}
    return {
        **sectors,
        "generation": said.generation,
        "generation_again": said.generation,
        "generation_end": said.generation,
        "health": health_bits(word, said.planner_heard),
        "x": mm_signed(pose.x_m),
        "y": mm_signed(pose.y_m),
        "heading": heading_cdeg(pose.yaw_rad),
        "quality": QUALITY.get(pose.mode, 0) if word & POSE_VALID else 0,
        "sigma_position": distance_mm(said.sigma_m),
        "sigma_heading": or_worst(math.degrees(said.sigma_rad) * 100.0),
        "speed": thousandths_signed(pose.v_mps),
        "turn": cdeg_signed(pose.w_radps),
        "pitch": cdeg_signed(pose.pitch_rad),
        "roll": cdeg_signed(pose.roll_rad),
        "faults": fault_count(word),
        "link_health": word % 2**16,
        "mode": pose.mode,
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
