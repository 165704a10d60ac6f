"""Which code has drawn each picture of the documents: docs/pictures/made_of.json.

Who draws a picture records it here, with a digest of the files that decide what it looks like. A
test compares: a picture that is older than the code that draws it has to be drawn again.
"""

import ast
import hashlib
import json
from collections.abc import Iterable, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / "docs" / "pictures"
LIST = PICTURES / "made_of.json"
Made = dict[str, dict[str, object]]  # by picture: `by` (a command), `of` (files), `digest`


def digest_of(names: Iterable[str], root: Path = ROOT) -> str:
    """Of the text of all files that these names (with * and **) find; none found: an error."""
    total = hashlib.sha256()
    for name in sorted(names):
        paths = sorted(path for path in root.glob(name) if path.is_file())
        if not paths:
            raise ValueError(f"no file is called {name}")
        for path in paths:
            total.update(path.relative_to(root).as_posix().encode() + b"\0")
            total.update(path.read_bytes() + b"\0")
    return total.hexdigest()[:16]


def with_neighbours(name: str, root: Path = ROOT) -> list[str]:
    """A module's file and those of its own folder that it imports, directly or through others."""
    found, open_names = set[str](), [name]
    package = Path(name).parent.as_posix().replace("/", ".") + "."
    while open_names:
        one = open_names.pop()
        found.add(one)
        for node in ast.walk(ast.parse((root / one).read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
                paths = [f"{n.replace('.', '/')}.py" for n in names if n.startswith(package)]
                open_names += [p for p in paths if p not in found and (root / p).exists()]
    return sorted(found)


def made(path: Path = LIST) -> Made:
    known: Made = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    return known


def record(pictures: Iterable[str], by: str, of: Sequence[str], path: Path = LIST) -> None:
    """These pictures have just been drawn by a command, by the code of these files."""
    known = made(path)
    for name in pictures:
        known[name] = {"by": by, "of": sorted(of), "digest": digest_of(of)}
    there = {name: known[name] for name in sorted(known) if (path.parent / name).exists()}
    path.write_text(json.dumps(there, indent=1) + "\n", encoding="utf-8")


def older_than_their_code(path: Path = LIST) -> list[str]:
    """What is to be drawn again, and by which command."""
    stale = []
    for name, entry in made(path).items():
        of, by = entry["of"], entry["by"]
        assert isinstance(of, list)
        if digest_of(of) != entry["digest"]:
            stale.append(f"{name}: {by}")
    return stale
