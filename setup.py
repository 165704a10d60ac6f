"""Builds mapod under one import name.

In the source tree every room is a package at the top. `core`, `hw` and the like would collide with
anybody's packages, so what is installed is `mapod.core`, `mapod.hw`, ...: the files are copied into
`mapod/` as they are, but for their imports of each other. Tools that need the simulation stay out.
"""

import ast
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).parent
ROOMS = {"core", "hw", "fakes", "recording", "tools"} | {
    path.stem for path in ROOT.glob("*.py") if path.name != "setup.py"
}
PAGE = [path.relative_to(ROOT).as_posix() for path in sorted(ROOT.glob("tools/view/page/*.*"))]
FILES = (
    "mapod.toml",
    "robots/ragno.toml",
    "robots/urg04lx.toml",
    "hw/mcu/mapod_link.h",
    "hw/mcu/example.c",
    "tools/flash/99-mapod.rules",
)
DATA = (*FILES, *PAGE)


def imports_of(source: bytes, path: Path) -> list[ast.ImportFrom]:
    """The imports of rooms, in order of lines."""
    found = []
    for node in ast.walk(ast.parse(source, path)):
        if isinstance(node, ast.Import) and {n.name.split(".")[0] for n in node.names} & ROOMS:
            raise SyntaxError(f"{path}:{node.lineno}: write `from {node.names[0].name} import ...`")
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in ROOMS:
            found.append(node)
    return found


def moved(source: bytes, path: Path) -> bytes:
    """The same file, importing `mapod.core` where it said `core`."""
    lines = source.splitlines(keepends=True)
    for node in imports_of(source, path):
        line = lines[node.lineno - 1]
        at = line.index(str(node.module).encode(), node.col_offset)
        lines[node.lineno - 1] = line[:at] + b"mapod." + line[at:]
    return b"".join(lines)


def files_of(module: str, names: list[str]) -> list[Path]:
    """The files that `from module import names` may load."""
    place = ROOT.joinpath(*module.split("."))
    paths = [place.with_suffix(".py"), place / "__init__.py"]
    paths += [place / f"{name}.py" for name in names]
    return [path for path in paths if path.exists()]


def tools_without_simulation() -> set[Path]:
    """The commands, and what they import of the tools, but for what imports fakes."""
    waiting, found = [*ROOT.glob("tools/cli/*.py"), ROOT / "tools" / "__init__.py"], set[Path]()
    while waiting:
        path = waiting.pop()
        nodes = imports_of(path.read_bytes(), path)
        modules = {str(node.module) for node in nodes}
        if path in found or any(module.split(".")[0] == "fakes" for module in modules):
            continue
        found |= {path, path.parent / "__init__.py"}
        for node in nodes:
            if str(node.module).split(".")[0] == "tools":
                waiting += files_of(str(node.module), [name.name for name in node.names])
    return found


def sources() -> list[Path]:
    """All Python files that are installed inside `mapod/`, relative to here."""
    paths = {ROOT / f"{room}.py" for room in ROOMS if (ROOT / f"{room}.py").exists()}
    for room in ("core", "hw", "recording"):
        paths |= {path for path in ROOT.glob(f"{room}/**/*.py") if "build" not in path.parts}
    return sorted(path.relative_to(ROOT) for path in paths | tools_without_simulation())


class BuildUnderOneName(build_py):
    """Copies the rooms into the package `mapod`."""

    def run(self) -> None:
        """Build; an editable install takes the files where they are."""
        super().run()
        if self.editable_mode:
            return
        built = {path.name: moved(path.read_bytes(), path) for path in ROOT.glob("mapod/*.py")}
        built |= {str(path): moved((ROOT / path).read_bytes(), path) for path in sources()}
        page = [str(path.relative_to(ROOT)) for path in ROOT.glob("tools/view/page/*.*")]
        built |= {name: (ROOT / name).read_bytes() for name in (*DATA, *page)}
        for name, content in built.items():
            target = Path(self.build_lib, "mapod", name)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)


setup(cmdclass={"build_py": BuildUnderOneName})
