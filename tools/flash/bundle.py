"""One file that holds all that a robot needs: `mapod-0.1.0-1a2b3c4d5e-x86_64-cp311.pyz`.

It is a zip that Python runs: `sudo python3.11 FILE install`. The same checkout and the same wheels
give the same id.
"""

import hashlib
import json
import os
import sys
import tempfile
import zipfile
from collections.abc import Iterable
from email import message_from_bytes
from pathlib import Path

from tools.checkout import commit
from tools.cli.options import ROOT
from tools.flash.robot.package import MANIFEST, WHEELS, contents_id, is_kept
from tools.flash.robot.places import FORM
from tools.flash.wheels import BundleError, Target, libc_of, libraries, own_wheel
from version import version

FLASH = ROOT / "tools" / "flash"
SYSTEM = ("mapod.service", "mapod.sysusers", "99-mapod.rules", "recover", "mapod-recover.service")
DOCUMENTS = ("docs/service.md", "docs/flash.md")
MAIN = '''"""Runs on the robot."""
import sys

if sys.version_info[:2] != (3, {minor}):
    sys.exit("mapod flash: this bundle is for Python 3.{minor}: run it with python3.{minor}")
from pathlib import Path

from tools.flash.robot.__main__ import main

sys.exit(main(sys.argv[1:], Path(sys.argv[0])))
'''
Files = dict[str, bytes | Path]


def make(target: Target, cache: Path, out: Path) -> Path:
    """Builds a bundle; `out` is a file, or a folder where it gets its own name.

    Raises BundleError, OSError.
    """
    with tempfile.TemporaryDirectory() as name:
        found = libraries(target, cache)
        return write([own_wheel(cache, Path(name)), *found], target, out)


def write(wheels: list[Path], target: Target, out: Path) -> Path:
    """The bundle of these wheels, the first of which is mapod's own."""
    files: Files = {f"{WHEELS}{path.name}": path for path in wheels}
    files |= {"__main__.py": MAIN.format(minor=target.python[1:]).encode()}
    code = [ROOT / "tools" / "__init__.py", FLASH / "__init__.py", *FLASH.glob("robot/*.py")]
    files |= {path.relative_to(ROOT).as_posix(): path for path in code}
    files |= {name: FLASH / name for name in SYSTEM} | {"mapod.toml": ROOT / "mapod.toml"}
    files |= {name: ROOT / name for name in DOCUMENTS if (ROOT / name).exists()}
    licences, texts = licences_of(wheels)
    files["licences.txt"] = texts.encode()
    about = {name: {"sha256": digest(of), "bytes": size(of)} for name, of in sorted(files.items())}
    manifest = {
        "form": FORM,
        "version": version(),
        "id": contents_id(about),
        "commit": commit(),
        "arch": target.arch,
        "python": f"cp{target.python}",
        "libc": libc_of(wheels),
        "installed_bytes": installed_bytes(wheels),
        "licences": licences,
        "files": about,
    }
    if out.is_dir():
        out = out / f"mapod-{manifest['version']}-{manifest['id']}-{target}.pyz"
    files[MANIFEST] = json.dumps(manifest, indent=1).encode()
    _write_zip(files, target, out)
    return out


def digest(of: bytes | Path) -> str:
    return hashlib.sha256(of if isinstance(of, bytes) else of.read_bytes()).hexdigest()


def size(of: bytes | Path) -> int:
    return len(of) if isinstance(of, bytes) else of.stat().st_size


def _write_zip(files: Files, target: Target, out: Path) -> None:
    """Stored as it is: wheels are compressed. The file is there whole, or not at all."""
    part = out.with_name(f".{out.name}.part")
    try:
        with part.open("wb") as file:
            file.write(f"#!/usr/bin/env python3.{target.python[1:]}\n".encode())
            with zipfile.ZipFile(file, "w") as archive:
                for name in sorted(files):
                    of = files[name]
                    content = of if isinstance(of, bytes) else of.read_bytes()
                    archive.writestr(zipfile.ZipInfo(name), content)
        part.chmod(0o755)
        os.replace(part, out)
    finally:
        part.unlink(missing_ok=True)


def installed_bytes(wheels: Iterable[Path]) -> int:
    """What the wheels unpack to on the robot."""
    total = 0
    for path in wheels:
        with zipfile.ZipFile(path) as wheel:
            total += sum(of.file_size for of in wheel.infolist() if is_kept(of.filename))
    return total


def licences_of(wheels: Iterable[Path]) -> tuple[list[dict[str, str]], str]:
    """Name, version and licence of each wheel; and their texts as one."""
    listed, texts = [], []
    for path in wheels:
        with zipfile.ZipFile(path) as wheel:
            names = wheel.namelist()
            [about] = [name for name in names if name.endswith(".dist-info/METADATA")]
            told = message_from_bytes(wheel.read(about))
            licence = told["License-Expression"] or told["License"] or _classified(told) or "?"
            one = {"name": told["Name"], "version": told["Version"]}
            listed.append({**one, "licence": licence.strip().splitlines()[0]})
            texts.append("{name} {version}: {licence}\n".format(**listed[-1]))
            for name in names:
                stem = name.rpartition("/")[2].upper()
                if ".dist-info/" in name and stem.startswith(("LICEN", "NOTICE", "COPYING")):
                    texts.append(f"\n--- {name}\n{wheel.read(name).decode('utf-8', 'replace')}\n")
    return listed, "\n".join(texts)


def _classified(told: "object") -> str:
    classes = getattr(told, "get_all")("Classifier", [])  # noqa: B009
    return "; ".join(line.rpartition(" :: ")[2] for line in classes if "License ::" in line)


def manifest_of(path: Path) -> dict[str, object]:
    """Raises BundleError: it is no bundle, or one of another mapod."""
    try:
        with zipfile.ZipFile(path) as archive:
            manifest: dict[str, object] = json.loads(archive.read(MANIFEST))
    except (OSError, zipfile.BadZipFile, KeyError, ValueError) as error:
        raise BundleError(f"{path} is no bundle, or a damaged one: {error}") from None
    if manifest.get("form") != FORM:
        raise BundleError(f"{path} is a bundle of another mapod: flash it with that one")
    return manifest


def tell(path: Path) -> None:
    """Name and sizes of a bundle, on stderr."""
    installed = int(str(manifest_of(path)["installed_bytes"])) / 1e6
    megabytes = path.stat().st_size / 1e6
    print(f"{path}: {megabytes:.0f} MB, {installed:.0f} MB installed", file=sys.stderr, flush=True)
