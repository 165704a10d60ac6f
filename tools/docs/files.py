"""The list of files, `docs/files.md`, made from their first lines: `python -m tools.docs.files`."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("core", "hw", "recording", "mapod_link", "fakes", "tools")
HEAD = "# The files\n\nMade by `python -m tools.docs.files` from the first line of each.\n"


def python_files() -> list[Path]:
    """All but packages' own `__init__.py`, those at the top first."""
    rooms = [path for room in ROOMS for path in (ROOT / room).rglob("*.py")]
    files = [path for path in rooms if path.name != "__init__.py"]
    return sorted(ROOT.glob("*.py")) + sorted(files, key=lambda path: (path.parent, path.name))


def file_list() -> str:
    text, folder = HEAD, None
    for path in python_files():
        place = path.relative_to(ROOT)
        if place.parent != folder:
            folder = place.parent
            text += f"\n## {'The top' if folder == Path() else f'`{folder}/`'}\n\n"
        about = path.read_text(encoding="utf-8").split('"""', 2)[1].strip()
        text += f"- `{place.name}`: {about.splitlines()[0].rstrip('.')}\n"
    return text


if __name__ == "__main__":
    (ROOT / "docs" / "files.md").write_text(file_list(), encoding="utf-8")
