"""`mapod.toml` to frozen, typed, checked structs, or `ConfigError`.

Every key is required and no other is allowed, so the file is complete and is its own manual.
Degrees appear here and in the file only. Port URLs are checked by `hw.ports.wires`.
Source: design, section 6.
"""

import contextlib
import math
import tomllib
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

Hz = Annotated[float, Meta(gt=0, le=1000)]
Degrees = Annotated[float, Meta(ge=-180, le=180)]
Offset = Annotated[float, Meta(ge=-5, le=5)]
Port = Annotated[str, Meta(min_length=1)]

KEY_BYTES = 32
LMS1XX_MODES = {(50, 0.5), (25, 0.25), (25, 0.5)}  # Hz, deg: lms111 sheet, section 1


class ConfigError(Exception):
    """A setting that can't be used; the text names the key, what was given and what is allowed."""


class Loop(Struct, frozen=True, forbid_unknown_fields=True):
    """The fixed rate of the one loop."""

    rate_hz: Annotated[float, Meta(ge=10, le=1000)]


class Robot(Struct, frozen=True, forbid_unknown_fields=True):
    """Wheels, limits of motion, and the ground that the body covers."""

    wheel_radius_m: Annotated[float, Meta(ge=0.01, le=2)]
    encoder_ppr: Annotated[int, Meta(ge=1, le=100_000)]
    gear_ratio: Annotated[float, Meta(ge=0.01, le=1000)]
    track_width_m: Annotated[float, Meta(ge=0.05, le=5)]
    max_speed_mps: Annotated[float, Meta(ge=0.01, le=20)]
    max_turn_radps: Annotated[float, Meta(ge=0.01, le=20)]
    max_accel_mps2: Annotated[float, Meta(ge=0.01, le=20)]
    max_turn_accel_radps2: Annotated[float, Meta(ge=0.01, le=100)]
    brake_mps2: Annotated[float, Meta(ge=0.01, le=20)]
    front_m: Annotated[float, Meta(ge=0, le=5)]
    rear_m: Annotated[float, Meta(ge=0, le=5)]
    width_m: Annotated[float, Meta(ge=0.05, le=5)]
    height_m: Annotated[float, Meta(ge=0.05, le=10)]
    stop_margin_m: Annotated[float, Meta(ge=0, le=2)]
    unknown_stops: bool
    start_clear_m: Annotated[float, Meta(ge=0, le=20)]
    enable_motors: bool


class Scanner(Struct, frozen=True, forbid_unknown_fields=True):
    """The laser scanner, its used field of view and where it sits on the body."""

    driver: Literal["lms111", "urg04lx"]
    port: Port
    dialect: Literal["auto", "binary", "ascii"]
    scan_rate_hz: Literal[25, 50]
    angular_step_deg: float
    first_deg: Annotated[float, Meta(ge=-45, le=225)]
    last_deg: Annotated[float, Meta(ge=-45, le=225)]
    mount_x_m: Offset
    mount_y_m: Offset
    mount_z_m: Annotated[float, Meta(gt=0, le=5)]
    mount_roll_deg: Degrees
    mount_tilt_deg: Annotated[float, Meta(ge=-90, le=90)]
    mount_yaw_deg: Degrees
    echo: Literal["first", "last", "both"]


class Ahrs(Struct, frozen=True, forbid_unknown_fields=True):
    """The attitude sensor and how its case is turned on the body."""

    driver: Literal["mti"]
    port: Port
    rate_hz: Annotated[float, Meta(ge=10, le=120)]
    mount_roll_deg: Degrees
    mount_pitch_deg: Degrees
    mount_yaw_deg: Degrees


class Drive(Struct, frozen=True, forbid_unknown_fields=True):
    """The motor controller, of which the encoder counters are read, and which moves the wheels."""

    driver: Literal["ax3500"]
    port: Port
    poll_hz: Annotated[float, Meta(ge=5, le=30)]
    left_channel: Literal[1, 2]
    right_channel: Literal[1, 2]
    invert: list[Literal[1, 2]]
    enter_rs232: bool
    full_power_mps: Annotated[float, Meta(ge=0.01, le=20)]


class Map(Struct, frozen=True, forbid_unknown_fields=True):
    """The elevation map."""

    method: Literal["beams", "reference_plane"]
    cells: Annotated[int, Meta(ge=3, le=2001)]
    cell_m: Annotated[float, Meta(ge=0.01, le=1)]
    cell_value: Literal["mean", "kalman", "certainty"]


class Obstacle(Struct, frozen=True, forbid_unknown_fields=True):
    """What height makes an obstacle, and how much of the map is sent."""

    h_pos_m: Annotated[float, Meta(gt=0, le=2)]
    h_neg_m: Annotated[float, Meta(ge=-2, lt=0)]
    window_cells: Annotated[int, Meta(ge=3, le=401)]
    soft_free_below_m: Annotated[float, Meta(ge=0, le=2)]
    free_max_age_s: Annotated[float, Meta(ge=1, le=1_000_000)]


class Ground(Struct, frozen=True, forbid_unknown_fields=True):
    """When the ground itself is taken to have changed (epsilon and eta of the paper)."""

    total_pitch_deg: Annotated[float, Meta(gt=0, le=45)]
    step_pitch_deg: Annotated[float, Meta(gt=0, le=45)]


class Planner(Struct, frozen=True, forbid_unknown_fields=True):
    """The wires to the planner and whoever else wants the map: one, or a list of them."""

    port: Port | Annotated[list[Port], Meta(min_length=1, max_length=8)]
    rate_hz: Annotated[float, Meta(ge=1, le=100)]
    push: bool
    key_file: str

    @property
    def ports(self) -> list[str]:
        """All of them."""
        return [self.port] if isinstance(self.port, str) else self.port


class Modbus(Struct, frozen=True, forbid_unknown_fields=True):
    """Where the register image is served: one port, or a list of them; "" is off."""

    port: str | Annotated[list[Port], Meta(max_length=8)]
    unit: Annotated[int, Meta(ge=1, le=238)]
    allow_drive: bool

    @property
    def ports(self) -> list[str]:
        """All of them."""
        given = [self.port] if isinstance(self.port, str) else self.port
        return [url for url in given if url]


class Log(Struct, frozen=True, forbid_unknown_fields=True):
    """What is logged, and how."""

    level: Literal["debug", "info", "warning", "error"]
    format: Literal["console", "json"]


class Config(Struct, frozen=True, forbid_unknown_fields=True):
    """The whole of `mapod.toml`."""

    loop: Loop
    robot: Robot
    scanner: Scanner
    ahrs: Ahrs
    drive: Drive
    map: Map
    obstacle: Obstacle
    ground: Ground
    planner: Planner
    modbus: Modbus
    log: Log


def load_config(text: str) -> Config:
    """The settings in a TOML text.

    Raises:
        ConfigError: not TOML, or a key is unknown, missing, of a wrong type or out of range.
    """
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"not valid TOML: {error}") from None
    return _config_from(table)


def _config_from(table: dict[str, Any]) -> Config:
    _check_keys(table)
    try:
        config = msgspec.convert(table, Config)
    except msgspec.ValidationError as error:
        raise ConfigError(_in_words(str(error), table)) from None
    _check_finite(table)
    _check_together(config)
    _check_built(config)
    return config


def key_from_bytes(content: bytes, path: str) -> bytes:
    """The planner link's key: 32 bytes, or 64 hex digits.

    Raises:
        ConfigError: neither.
    """
    if len(content) == KEY_BYTES:
        return content
    with contextlib.suppress(ValueError):
        key = bytes.fromhex(content.decode("ascii", "replace").strip())
        if len(key) == KEY_BYTES:
            return key
    raise ConfigError(
        "planner.key_file: must hold 32 bytes or 64 hex digits, "
        f"{path!r} holds {len(content)} bytes"
    )


def with_changes(config: Config, **sections: dict[str, Any]) -> Config:
    """The same settings with some keys changed, `map={"cells": 401}`, and checked together.

    Raises:
        ConfigError: as load_config.
    """
    table = msgspec.to_builtins(config)
    for section, keys in sections.items():
        table[section] = {**table[section], **keys}
    return _config_from(table)


def _check_keys(table: dict[str, Any]) -> None:
    """Unknown and missing sections and keys, all of them in one text."""
    faults = []
    sections = {field.name: field.type for field in msgspec.structs.fields(Config)}
    for section in [*table, *(name for name in sections if name not in table)]:
        if section not in sections:
            faults.append(f"[{section}]: unknown section; allowed are {', '.join(sections)}")
        elif not isinstance(table.get(section, {}), dict):
            faults.append(f"{section}: must be a section, is {table[section]!r}")
        else:
            given = table.get(section, {})
            keys = [field.name for field in msgspec.structs.fields(sections[section])]
            faults += [
                f"{section}.{key}: unknown key; allowed are {', '.join(keys)}"
                for key in given
                if key not in keys
            ]
            faults += [f"{section}.{key}: missing" for key in keys if key not in given]
    if faults:
        raise ConfigError("; ".join(faults))


def _in_words(error: str, table: dict[str, Any]) -> str:
    """msgspec's finding as: the key, what is allowed, what was given."""
    section, _, rest = error.rpartition("`$.")[2].rstrip("`").partition(".")
    key = rest.partition("[")[0]
    sections = {field.name: field.type for field in msgspec.structs.fields(Config)}
    types = {field.name: field.type for field in msgspec.structs.fields(sections[section])}
    return f"{section}.{key}: must be {_allowed(types[key])}, is {table[section][key]!r}"


def _allowed(field_type: Any) -> str:
    """The values that a field may have, in words."""
    info = msgspec.inspect.type_info(field_type)
    if isinstance(info, msgspec.inspect.Metadata):
        info = info.type
    match info:
        case msgspec.inspect.ListType():
            return f"a list, each of it {_allowed_literal(info.item_type)}"
        case msgspec.inspect.LiteralType():
            return _allowed_literal(info)
        case msgspec.inspect.IntType():
            return f"a whole number {_span(info)}".rstrip()
        case msgspec.inspect.FloatType():
            return f"a number {_span(info)}".rstrip()
        case msgspec.inspect.BoolType():
            return "true or false"
        case msgspec.inspect.StrType(min_length=int()):
            return "a text that is not empty"
        case msgspec.inspect.UnionType():
            return "a text, or a list of up to 8 texts that are not empty"
        case _:
            return "a text"


def _allowed_literal(info: Any) -> str:
    return " or ".join(repr(value) for value in info.values)


def _span(info: Any) -> str:
    above = (
        f"from {info.ge:g}"
        if info.ge is not None
        else f"above {info.gt:g}"
        if info.gt is not None
        else ""
    )
    below = (
        f"to {info.le:g}"
        if info.le is not None
        else f"below {info.lt:g}"
        if info.lt is not None
        else ""
    )
    return f"{above} {below}".strip()


def _check_finite(table: dict[str, Any]) -> None:
    """NaN passes no range, infinities might: neither is a length or an angle."""
    for section, keys in table.items():
        for key, value in keys.items():
            if isinstance(value, float) and not math.isfinite(value):
                raise ConfigError(f"{section}.{key}: must be a finite number, is {value}")


def _check_together(config: Config) -> None:
    """What only two keys together can break."""
    scanner, drive = config.scanner, config.drive
    if (scanner.scan_rate_hz, scanner.angular_step_deg) not in LMS1XX_MODES:
        raise ConfigError(
            "scanner.angular_step_deg: must be 0.5 at 50 Hz, 0.25 or 0.5 at 25 Hz, "
            f"is {scanner.angular_step_deg} at {scanner.scan_rate_hz} Hz"
        )
    if scanner.last_deg - scanner.first_deg < scanner.angular_step_deg:
        raise ConfigError(
            "scanner.last_deg: must be at least one angular_step_deg above "
            f"first_deg = {scanner.first_deg}, is {scanner.last_deg}"
        )
    if drive.left_channel == drive.right_channel:
        raise ConfigError(
            f"drive.right_channel: must differ from left_channel = {drive.left_channel}, "
            f"is {drive.right_channel}"
        )
    if config.obstacle.window_cells > config.map.cells:
        raise ConfigError(
            f"obstacle.window_cells: must be at most map.cells = {config.map.cells}, "
            f"is {config.obstacle.window_cells}"
        )
    if config.obstacle.soft_free_below_m > 0 and scanner.echo != "both":
        raise ConfigError(
            'obstacle.soft_free_below_m: needs scanner.echo = "both", for beams echo twice in soft '
            f"things; is {config.obstacle.soft_free_below_m} with echo = {scanner.echo!r}"
        )
    for key, ports in (("planner", config.planner.ports), ("modbus", config.modbus.ports)):
        if len(set(ports)) < len(ports):
            raise ConfigError(f"{key}.port: each port may be given once, is {ports}")
    if abs(config.map.cell_m * 1000 - round(config.map.cell_m * 1000)) > 1e-6:
        raise ConfigError(
            "map.cell_m: must be whole millimetres (the planner's wire counts them), "
            f"is {config.map.cell_m}"
        )


def _check_built(config: Config) -> None:
    """Values that the design names and that this version does not have yet: said, not ignored."""
    for key, value, built in (
        ("scanner.driver", config.scanner.driver, ("lms111",)),
        ("map.cell_value", config.map.cell_value, ("mean", "kalman")),
    ):
        if value not in built:
            allowed = " or ".join(repr(choice) for choice in built)
            raise ConfigError(f"{key}: this version has only {allowed}, is {value!r}")
