"""The structs of the C header of the planner link and of its host library, for ctypes."""

import ctypes
from ctypes import c_bool as flag
from ctypes import c_int16 as i16
from ctypes import c_int32 as i32
from ctypes import c_uint8 as u8
from ctypes import c_uint16 as u16
from ctypes import c_uint32 as u32

KINDS = {
    1: "geom", 2: "pose", 3: "map", 4: "digest", 5: "stop_zone", 6: "tile",
    16: "unknown_type", 17: "foreign_map", 18: "too_large",
}  # fmt: skip
REASONS = {1: "cobs", 2: "length", 3: "crc", 4: "version", 5: "flags", 6: "body", 7: "tag"}
VALUES = 1392  # of a piece of a tile
NOT_KNOWN = -(2**31)  # of a tile's value
NO_YAW = -32_768


class Pose(ctypes.Structure):
    """struct mapod_pose."""

    _fields_ = (
        ("x_mm", i32),
        ("y_mm", i32),
        *((name, i16) for name in ("yaw", "pitch", "roll", "v_mmps", "w_mradps")),
        ("health", u16),
        *((name, u8) for name in ("age_scan", "age_attitude", "age_encoders", "mode")),
        ("t_ms", u32),
    )


class ExternalPose(ctypes.Structure):
    """struct mapod_external_pose."""

    _fields_ = (
        ("x_mm", i32), ("y_mm", i32), ("yaw", i16), ("sigma_x_mm", u16), ("sigma_y_mm", u16),
        ("correlation", i16), ("sigma_yaw", u16), ("age_ms", u16),
    )  # fmt: skip


class Ask(ctypes.Structure):
    """struct mapod_ask."""

    _fields_ = (
        ("id", u16), ("what", u8), ("layer", u8), ("i", i16), ("j", i16), ("width", u16),
        ("height", u16),
    )  # fmt: skip


class Zone(ctypes.Structure):
    """struct mapod_zone."""

    _fields_ = (
        ("arrived_ms", u32), ("t_ms", u32), ("free_ahead_mm", u16), ("obstacle_ahead_mm", u16),
        ("free_behind_mm", u16), ("obstacle_behind_mm", u16), ("contact_ms", u16),
        ("allowed_ahead_mmps", u16), ("allowed_behind_mmps", u16), ("nearest_mm", u16),
        ("bearing", i16), ("state", u8), ("causes", u8),
    )  # fmt: skip


class Piece(ctypes.Structure):
    """struct piece: of a tile; `values` as the header gives them."""

    _fields_ = (
        *((name, u16) for name in ("id", "width", "height", "count", "cell_mm")),
        ("i", i16), ("j", i16), ("layer", u8), ("status", u8), ("geom_id", u8), ("first", u32),
        ("values", i32 * VALUES),
    )  # fmt: skip


class State(ctypes.Structure):
    """struct state: everything small that a receiver knows."""

    _fields_ = (
        *((name, u32) for name in ("session", "mask", "newest_t_ms", "newest_piece")),
        *((name, u16) for name in ("width", "height", "cell_mm", "tick_ms", "stale_ms")),
        *((name, u16) for name in ("last", "gap", "bad_frames")),
        ("ox", i16), ("oy", i16), ("geom_id", u8),
        *((name, flag) for name in ("has_geom", "has_pose", "blank", "suspect", "stale", "any")),
        *((name, flag) for name in ("need_geom", "need_full", "digest_ok", "auth_failed")),
        ("advice", u8), ("why", u8), ("zone_advice", u8),
    )  # fmt: skip
