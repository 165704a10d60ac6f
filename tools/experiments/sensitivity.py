"""Each constant of method `surface` halved and doubled: what changes in the experiments.

    python -m tools.experiments.sensitivity [--only 7] [--constants GATE BEND] [--picture file.png]
                                            [--kept file.json]

What was found is kept in a file, if one is given: what is in it already is not run again, and the
picture shows all of it.

Each value runs in a process of its own, with kernels compiled anew: two minutes or so. Told is in
how many rows of the table a value is better or worse than the shipped one, and unsafe: more cells
free on an obstacle, more obstacles missed, or a ditch, a kerb or glass that is barred no more.
"""

import argparse
import ast
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.util import module_from_spec, spec_from_file_location
from os import environ
from pathlib import Path

from PIL import Image, ImageDraw

ROOT = Path(__file__).resolve().parents[2]
MODULE = "core.mapping.surface.constants"
SOURCE = ROOT / "core" / "mapping" / "surface" / "constants.py"
FACTORS = (0.5, 2.0)
UNSAFE = ("free on", "free cells in", "missed", "wrongly cleared")
BARS = "bars the way"
Rows = dict[str, tuple[float, str]]  # value and what is better, by experiment and quantity
Key = tuple[str, float]  # a constant, and the factor
Found = dict[str, list[str]]  # rows that changed, by "better", "worse" and "unsafe"
COLOURS = {"same": (225, 225, 225), "better": (60, 170, 75), "worse": (250, 165, 60)}
COLOURS["unsafe"] = (215, 40, 40)
ROW_PX, NAME_PX, WIDE_PX = 18, 150, 90


def constants() -> list[str]:
    """Those that stand for themselves, in the order of the file."""
    found = []
    for node in ast.parse(SOURCE.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign):
            names = [part.id for part in ast.walk(node.targets[0]) if isinstance(part, ast.Name)]
            used = [part.id for part in ast.walk(node.value) if isinstance(part, ast.Name)]
            if not any(name.isupper() for name in used):
                found += names
    return found


def scaled(name: str, factor: float) -> str:
    """The text of the module in which a constant is so many times as large; at least 1 if whole."""
    tree = ast.parse(SOURCE.read_text(encoding="utf-8"))
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else []
        for target in targets:
            several = isinstance(target, ast.Tuple)
            parts = target.elts if isinstance(target, ast.Tuple) else [target]
            for k, part in enumerate(parts):
                if not (isinstance(part, ast.Name) and part.id == name):
                    continue
                assert isinstance(node, ast.Assign)
                old = node.value.elts[k] if isinstance(node.value, ast.Tuple) else node.value
                whole = isinstance(old, ast.Constant) and type(old.value) is int
                text = f"({ast.unparse(old)}) * {factor}"
                new = ast.parse(f"max(1, round({text}))" if whole else text, mode="eval").body
                if several and isinstance(node.value, ast.Tuple):
                    node.value.elts[k] = new
                else:
                    node.value = new
    return ast.unparse(ast.fix_missing_locations(tree))


def run_one(name: str, factor: float, only: str) -> Rows:
    """In this process, which must not have loaded the method yet: the experiments."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "constants.py"
        path.write_text(scaled(name, factor) if name else SOURCE.read_text(encoding="utf-8"))
        spec = spec_from_file_location(MODULE, path)
        assert spec is not None
        assert spec.loader is not None
        sys.modules[MODULE] = module = module_from_spec(spec)
        spec.loader.exec_module(module)
        from tools.experiments import trial
        from tools.experiments.runner import experiments

        trial.ALONE.append("surface")
        rows: Rows = {}
        for title, run in experiments().items():
            if title.startswith(only) and not title.startswith(("5.1", "5.5")):  # of two methods
                for row in run(False, Path(folder)).rows:
                    value = row.values.get("surface", math.nan)
                    rows[f"{row.experiment}, {row.quantity}"] = value, row.aim
        return rows


def asked(name: str, factor: float, only: str) -> Rows:
    """The same in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "tools.experiments.sensitivity", "--only", only]
        command += ["--one", name, str(factor)]
        environment = environ | {"NUMBA_CACHE_DIR": folder}
        done = subprocess.run(
            command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True
        )
        rows: Rows = json.loads(done.stdout.splitlines()[-1])
        return rows


def judged(before: Rows, after: Rows) -> Found:
    """Rows by "better", "worse" and "unsafe"; what differs by less than 2 % is the same."""
    found: Found = {"better": [], "worse": [], "unsafe": []}
    for key, (new, aim) in after.items():
        old = before[key][0]
        if aim == "none" or math.isnan(old + new) or abs(new - old) <= 0.02 * max(abs(old), 0.5):
            continue
        is_worse = (new > old) is (aim == "less")
        is_danger = any(word in key for word in UNSAFE) or (BARS in key and new == 0.0)
        kind = "better" if not is_worse else "unsafe" if is_danger else "worse"
        found[kind].append(f"{key}: {old:.2f} -> {new:.2f}")
    return found


def kept_in(path: Path | None) -> dict[Key, Found]:
    """What an earlier run has found; nothing where there is no such file."""
    if path is None or not path.exists():
        return {}
    rows = json.loads(path.read_text(encoding="utf-8"))
    return {(name, factor): found for name, factor, found in rows}


def keep(path: Path | None, told: dict[Key, Found]) -> None:
    if path is not None:
        rows = [[*key, found] for key, found in told.items()]
        path.write_text(json.dumps(rows, indent=1), encoding="utf-8")


def draw(path: Path, told: dict[Key, Found]) -> None:
    """A row a constant, a field a factor: the worst that happens, and in how many rows."""
    names = [name for name in constants() if all((name, factor) in told for factor in FACTORS)]
    size = (NAME_PX + WIDE_PX * len(FACTORS), ROW_PX * (1 + len(names)))
    sheet = Image.new("RGB", size, (255, 255, 255))
    pen = ImageDraw.Draw(sheet)
    for k, factor in enumerate(FACTORS):
        pen.text((NAME_PX + k * WIDE_PX + 4, 3), f"times {factor:g}", fill=(0, 0, 0))
    for row, name in enumerate(names, 1):
        pen.text((4, row * ROW_PX + 3), name, fill=(0, 0, 0))
        for k, factor in enumerate(FACTORS):
            found = told[name, factor]
            kind = next((kind for kind in ("unsafe", "worse", "better") if found[kind]), "same")
            left, top = NAME_PX + k * WIDE_PX, row * ROW_PX
            pen.rectangle((left, top, left + WIDE_PX - 2, top + ROW_PX - 2), fill=COLOURS[kind])
            counts = "  ".join(f"{kind[0]}{len(keys)}" for kind, keys in found.items() if keys)
            pen.text((left + 4, top + 3), counts, fill=(0, 0, 0))
    sheet.save(path)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tools.experiments.sensitivity", description=__doc__)
    parser.add_argument("--only", default="", help="experiments whose name begins so")
    parser.add_argument("--constants", nargs="*", default=constants(), help="these; all of them")
    parser.add_argument("--picture", type=Path, help="a PNG file")
    parser.add_argument("--kept", type=Path, help="a JSON file to go on from and to write")
    parser.add_argument("--jobs", type=int, default=1, help="processes at once")
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.one:
        print(json.dumps(run_one(options.one[0], float(options.one[1]), options.only)))
        return 0
    told = kept_in(options.kept)
    wanted = [(name, factor) for name in options.constants for factor in FACTORS]
    wanted = [key for key in wanted if key not in told]
    before = asked("", 1.0, options.only) if wanted else {}
    with ThreadPoolExecutor(options.jobs) as pool:
        for key, after in zip(
            wanted, pool.map(lambda key: asked(key[0], key[1], options.only), wanted), strict=True
        ):
            told[key] = found = judged(before, after)
            keep(options.kept, told)
            counts = ", ".join(f"{len(keys)} {kind}" for kind, keys in found.items())
            print(f"{key[0]} times {key[1]:g}: {counts}", flush=True)
            print("".join(f"  {kind}: {row}\n" for kind in found for row in found[kind]), end="")
    if options.picture:
        draw(options.picture, told)
    return 0


if __name__ == "__main__":
    sys.exit(main())
