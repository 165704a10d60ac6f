"""The settings file as a target: any text is settings that are read back as they are, or refused.

The first byte says how the text is taken: as a whole file, or as sections that change the shipped
one. A refusal is one line, of printable letters.
"""

import tomllib
from functools import cache
from pathlib import Path

from config_file import key_from_bytes, load_config, text_from, with_changes
from core.config import Config, ConfigError
from tools.fuzz.program import refused

ROOT = Path(__file__).resolve().parents[2]
WHOLE, CHANGES, KEY = range(3)
MOST_REFUSAL = 20_000  # letters: each key that can't be is named


@cache
def shipped() -> Config:
    return load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))


def run(data: bytes) -> int:
    """1 where they are settings. Raises AssertionError."""
    way, content = (data[0] % 3 if data else WHOLE), data[1:]
    try:
        if way == KEY:
            assert len(key_from_bytes(content, "key")) == 32
            return 1
        text = content.decode("utf-8")
        config = load_config(text) if way == WHOLE else changed(text)
    except UnicodeDecodeError:
        return 0
    except ConfigError as error:
        return refused(error, MOST_REFUSAL)
    assert load_config(text_from(config)) == config, "settings are not read back as they are"
    return 1


def changed(text: str) -> Config:
    """The shipped settings with these sections over them. Raises ConfigError."""
    try:
        table = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ConfigError(str(error) or "nested too deep") from None
    known = Config.__struct_fields__
    sections = {name: table[name] for name in known if isinstance(table.get(name), dict)}
    return with_changes(shipped(), **sections)


def write_seeds(folder: Path) -> None:
    """The shipped file, each section of each robot by itself, and keys."""
    text = (ROOT / "mapod.toml").read_bytes()
    bare = text_from(shipped())
    (folder / "whole").write_bytes(bytes([WHOLE]) + bare.encode())
    (folder / "commented").write_bytes(bytes([WHOLE]) + text[:4000])
    for number, section in enumerate(bare.split("\n\n")):
        (folder / f"section-{number}").write_bytes(bytes([CHANGES]) + section.encode())
    for number, value in enumerate(
        ("1e999", "nan", "-1", '""', "[[1,2],[3]]", "true", "1_0", "{}")
    ):
        told = f"[map]\ncells = {value}\n[scanner]\nport = {value}\n[paths]\nfile = {value}\n"
        (folder / f"value-{number}").write_bytes(bytes([CHANGES]) + told.encode())
    (folder / "key-hex").write_bytes(bytes([KEY]) + b"5a" * 32)
    (folder / "key-bytes").write_bytes(bytes([KEY]) + bytes(range(32)))
