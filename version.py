"""Which version of mapod this is."""

import tomllib
from importlib import metadata
from pathlib import Path


def version() -> str:
    """The version in pyproject.toml: of the checkout, or as installed from it."""
    path = Path(__file__).parent / "pyproject.toml"
    if not path.exists():
        return metadata.version("mapod")
    return str(tomllib.loads(path.read_text(encoding="utf-8"))["project"]["version"])
