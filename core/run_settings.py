"""The settings of the robot and of a run: sections of `mapod.toml` that name no driver."""

from typing import Annotated, Literal

from msgspec import Meta, Struct

Port = Annotated[str, Meta(min_length=1)]


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


class Motion(Struct, frozen=True, forbid_unknown_fields=True):
    """What tells where the body is."""

    source: Literal["wheels", "external", "rail"]


class Planner(Struct, frozen=True, forbid_unknown_fields=True):
    """The wires to the planner and whoever else wants the map: one, or a list of them."""

    port: Port | Annotated[list[Port], Meta(min_length=1, max_length=8)]
    rate_hz: Annotated[float, Meta(ge=1, le=100)]
    push: bool
    key_file: str

    @property
    def ports(self) -> list[str]:
        return [self.port] if isinstance(self.port, str) else self.port


class Modbus(Struct, frozen=True, forbid_unknown_fields=True):
    """Where the register image is served: one port, or a list of them; "" is off."""

    port: str | Annotated[list[Port], Meta(max_length=8)]
    unit: Annotated[int, Meta(ge=1, le=238)]
    allow_drive: bool

    @property
    def ports(self) -> list[str]:
        given = [self.port] if isinstance(self.port, str) else self.port
        return [url for url in given if url]


class Log(Struct, frozen=True, forbid_unknown_fields=True):
    """What is logged, and how."""

    level: Literal["debug", "info", "warning", "error"]
    format: Literal["console", "json"]


class Record(Struct, frozen=True, forbid_unknown_fields=True):
    """What is recorded of a run, and where; "" is off."""

    path: str
    rate_hz: Annotated[float, Meta(ge=0.1, le=20)]
    max_mb: Annotated[float, Meta(ge=1, le=10_000_000)]
    file_mb: Annotated[float, Meta(ge=1, le=10_000)]
    flight: str
    flight_keep: Annotated[int, Meta(ge=1, le=1000)]
