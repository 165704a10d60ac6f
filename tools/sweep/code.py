"""Which code decides a job: a digest of its files, so that rows of other code are not mixed in."""

import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]  # of the sources; of the package where it is installed
KINDS = {".py", ".toml", ".c", ".h"}
APP = ("app.py", "config_file.py", "jit.py", "wiring.py", "core", "hw", "mapod_link")


def digest_of(*parts: bytes | str) -> str:
    """Hex digest of several pieces, none of which runs into the next."""
    total = hashlib.blake2b(digest_size=16)
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        total.update(len(data).to_bytes(8, "little") + data)
    return total.hexdigest()


@cache
def code_digest(*names: str) -> str:
    """Of the app's files, and of these files and folders, relative to the sources' root."""
    parts: list[bytes | str] = []
    for path in sorted({path for name in (*APP, *names) for path in _files(ROOT / name)}):
        parts += [path.relative_to(ROOT).as_posix(), path.read_bytes()]
    return digest_of(*parts)


def _files(path: Path) -> Iterator[Path]:
    found = path.rglob("*") if path.is_dir() else [path]
    for one in found:
        if one.suffix in KINDS and "build" not in one.parts and one.is_file():
            yield one
