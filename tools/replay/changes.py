"""Single settings changed for a replay: `map.cell_m=0.1`, checked as those of a file are."""

import tomllib
from collections.abc import Sequence
from typing import Any

from config_file import with_changes
from core.config import Config, ConfigError, table_from


def changed(config: Config, given: Sequence[str]) -> Config:
    """The settings with those that are given as `section.key=value`, all of them together.

    Raises:
        ConfigError: a text is of another form, or a key or value can't be.
    """
    sections: dict[str, dict[str, Any]] = {}
    known = table_from(config)
    for text in given:
        name, has_value, value = text.partition("=")
        section, _, key = name.strip().partition(".")
        if not has_value or not key:
            raise ConfigError(f"--set {text!r}: must be section.key=value, say map.cell_m=0.1")
        if section not in known:
            raise ConfigError(f"[{section}]: unknown section; allowed are {', '.join(known)}")
        sections.setdefault(section, {})[key] = _value(value.strip())
    return with_changes(config, **sections)


def _value(text: str) -> Any:
    """As the settings file has it; what is none of its values stands for itself, as a text."""
    try:
        [value] = tomllib.loads(f"value = {text}").values()
    except (tomllib.TOMLDecodeError, ValueError):
        return text
    return value
