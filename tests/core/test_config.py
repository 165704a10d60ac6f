"""Settings: the shipped file, and every way of getting one wrong."""

import tomllib
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.config import Config, ConfigError, key_from_bytes, load_config
from tests import ROOT

SHIPPED = (ROOT / "mapod.toml").read_text(encoding="utf-8")
TABLE = tomllib.loads(SHIPPED)
KEYS = [(section, key) for section, keys in TABLE.items() for key in keys]


def toml_from(table: dict[str, Any]) -> str:
    """A table of tables of plain values as TOML."""
    lines = []
    for section, keys in table.items():
        lines.append(f"[{section}]")
        for key, value in keys.items():
            text = str(value).lower() if isinstance(value, bool) else repr(value)
            lines.append(f"{key} = {text}".replace("'", '"'))
    return "\n".join(lines)


def with_value(section: str, key: str, value: Any) -> str:
    """The shipped settings with one of them changed, as TOML."""
    return toml_from({**TABLE, section: {**TABLE[section], key: value}})


def test_the_shipped_file_is_the_papers_robot() -> None:
    config = load_config(SHIPPED)
    scanner = config.scanner
    assert (scanner.mount_z_m, scanner.mount_tilt_deg) == (1.08, 7.5)
    assert (scanner.first_deg, scanner.last_deg) == (30.0, 150.0)
    assert (scanner.scan_rate_hz, scanner.angular_step_deg) == (25, 0.25)
    assert (config.map.cells, config.map.cell_m, config.obstacle.window_cells) == (101, 0.2, 101)
    assert (config.obstacle.h_pos_m, config.obstacle.h_neg_m) == (0.10, -0.10)
    assert (config.loop.rate_hz, config.robot.encoder_ppr) == (200, 500)
    assert config.robot.enable_motors is False
    assert config.robot.unknown_stops is True
    assert config.robot.start_clear_m == 0.0


@pytest.mark.parametrize(("section", "key"), KEYS)
def test_a_missing_key_is_named(section: str, key: str) -> None:
    table = {**TABLE, section: {k: v for k, v in TABLE[section].items() if k != key}}
    with pytest.raises(ConfigError, match=rf"{section}\.{key}: missing"):
        load_config(toml_from(table))


@pytest.mark.parametrize(("section", "key"), KEYS)
def test_a_wrong_type_is_named_with_what_was_given_and_what_is_allowed(
    section: str, key: str
) -> None:
    with pytest.raises(ConfigError) as error:
        load_config(with_value(section, key, [["x"]]))
    assert str(error.value).startswith(f"{section}.{key}: must be ")
    assert str(error.value).endswith("is [['x']]")


@pytest.mark.parametrize("section", TABLE)
def test_an_unknown_key_is_named_with_the_known_ones(section: str) -> None:
    with pytest.raises(ConfigError, match=rf"{section}\.colour: unknown key; allowed are .*"):
        load_config(with_value(section, "colour", 1))


def test_an_unknown_and_a_missing_section_are_named() -> None:
    with pytest.raises(ConfigError, match=r"\[logs\]: unknown section.*log\.level: missing"):
        load_config(SHIPPED.replace("[log]", "[logs]"))


@pytest.mark.parametrize(
    ("section", "key", "value", "told"),
    [
        ("loop", "rate_hz", 5, "from 10 to 1000, is 5"),
        ("loop", "rate_hz", True, "a number from 10 to 1000, is True"),
        ("robot", "encoder_ppr", 0, "a whole number from 1 to 100000, is 0"),
        ("robot", "enable_motors", 1, "true or false, is 1"),
        ("robot", "max_turn_radps", 0.0, "from 0.01 to 20, is 0.0"),
        ("robot", "brake_mps2", 0.0, "from 0.01 to 20, is 0.0"),
        ("robot", "start_clear_m", -1.0, "from 0 to 20, is -1.0"),
        ("robot", "unknown_stops", "no", "true or false, is 'no'"),
        ("drive", "full_power_mps", 0.0, "from 0.01 to 20, is 0.0"),
        ("scanner", "mount_z_m", 0.0, "above 0 to 5, is 0.0"),
        ("scanner", "scan_rate_hz", 30, "25 or 50, is 30"),
        ("scanner", "angular_step_deg", 0.1, "0.25 or 0.5 at 25 Hz, is 0.1 at 25 Hz"),
        ("scanner", "last_deg", 30.0, "above first_deg = 30.0, is 30.0"),
        ("scanner", "port", "", "not empty, is ''"),
        ("drive", "invert", [3], "a list, each of it 1 or 2, is [3]"),
        ("scanner", "accepted_status", [1], "a list of whole numbers from 2 to 255, is [1]"),
        ("drive", "right_channel", 1, "must differ from left_channel = 1, is 1"),
        ("map", "cells", 101.0, "a whole number from 3 to 2001, is 101.0"),
        ("map", "cell_m", float("nan"), "from 0.01 to 1, is nan"),
        ("map", "cell_m", 0.0333, "whole millimetres"),
        ("map", "cell_value", "certainty", "this version has only 'mean' or 'kalman'"),
        ("obstacle", "soft_free_below_m", 0.3, 'needs scanner.echo = "both"'),
        ("obstacle", "h_neg_m", 0.1, "is 0.1"),
        ("obstacle", "window_cells", 103, "at most map.cells = 101, is 103"),
    ],
)
def test_a_value_out_of_range_is_told_with_its_range(
    section: str, key: str, value: Any, told: str
) -> None:
    with pytest.raises(ConfigError) as error:
        load_config(with_value(section, key, value))
    assert told in str(error.value)
    assert key in str(error.value)


def test_motors_may_be_enabled_and_either_dialect_be_asked_for() -> None:
    assert load_config(with_value("robot", "enable_motors", True)).robot.enable_motors
    for dialect in ("auto", "binary", "ascii"):
        config = load_config(with_value("scanner", "dialect", dialect))
        assert config.scanner.dialect == dialect


@pytest.mark.parametrize(
    ("content", "good"), [(bytes(range(32)), True), (b"ab" * 32 + b"\n", True), (b"ab" * 20, False)]
)
def test_a_key_is_32_bytes_or_64_hex_digits(content: bytes, good: bool) -> None:
    if good:
        assert len(key_from_bytes(content, "key")) == 32
    else:
        with pytest.raises(ConfigError, match="32 bytes or 64 hex digits, 'key' holds 40 bytes"):
            key_from_bytes(content, "key")


def test_text_that_is_not_toml_is_told_with_its_place() -> None:
    with pytest.raises(ConfigError, match=r"not valid TOML: .*line 2"):
        load_config("[loop]\nrate_hz = \n")


def test_settings_are_frozen() -> None:
    config = load_config(SHIPPED)
    with pytest.raises(AttributeError):
        config.loop.rate_hz = 100  # type: ignore[misc]


VALUES: st.SearchStrategy[Any] = st.one_of(
    st.integers(), st.floats(), st.booleans(), st.text(alphabet="abc", max_size=4), st.just([])
)


@given(place=st.sampled_from(KEYS), value=VALUES)
def test_any_value_anywhere_gives_settings_or_an_error_that_names_the_key(
    place: tuple[str, str], value: Any
) -> None:
    told = ""
    config: Config | None = None
    try:
        config = load_config(with_value(*place, value))
    except ConfigError as error:
        told = str(error)
    assert config is not None or place[1] in told or "TOML" in told
    if config is not None:
        assert msgspec.to_builtins(config)[place[0]][place[1]] == value
