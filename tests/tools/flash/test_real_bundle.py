"""The bundle as a robot gets it: mapod itself, all libraries, both processors.

The libraries come from `build/wheels`, or from the package index where they are not there yet.
"""

import io
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.tools.flash.stand_in import PYTHON, flashed
from tools.cli.flash import CACHE
from tools.flash.bundle import make, manifest_of
from tools.flash.robot.package import WHEELS
from tools.flash.wheels import BundleError, Target

pytestmark = pytest.mark.slow
ELF_MACHINE = {"x86_64": 62, "aarch64": 183}  # elf(5), e_machine


def bundle_for(arch: str, folder: Path) -> Path:
    try:
        return make(Target(arch, PYTHON), CACHE, folder)
    except BundleError as error:
        if "download" not in str(error):
            raise
        pytest.skip(f"no network, and no libraries in build/wheels: {error}")


def machines_of(path: Path) -> set[int]:
    """The processors that the libraries' machine code is for."""
    found = set()
    with zipfile.ZipFile(path) as bundle:
        for name in bundle.namelist():
            if name.startswith(WHEELS):
                with zipfile.ZipFile(io.BytesIO(bundle.read(name))) as wheel:
                    for member in wheel.namelist():
                        if ".so" in Path(member).suffixes:
                            head = wheel.open(member).read(20)
                            assert head[:4] == b"\x7fELF"
                            found.add(int.from_bytes(head[18:20], "little"))
    return found


@pytest.mark.parametrize("arch", ELF_MACHINE)
def test_a_bundle_is_for_one_processor_and_the_same_each_time(arch: str, tmp_path: Path) -> None:
    path = bundle_for(arch, tmp_path)
    assert machines_of(path) == {ELF_MACHINE[arch]}
    manifest = manifest_of(path)
    assert (manifest["arch"], manifest["python"]) == (arch, f"cp{PYTHON}")
    licences = manifest["licences"]
    assert isinstance(licences, list)
    assert {"mapod", "numpy", "numba", "llvmlite", "msgspec"} <= {of["name"] for of in licences}
    assert all(of["licence"] not in ("", "?") for of in licences)
    (tmp_path / "again").mkdir()
    assert bundle_for(arch, tmp_path / "again").name == path.name


def test_mapod_is_installed_and_has_its_kernels(tmp_path: Path) -> None:
    path, root = bundle_for(os.uname().machine, tmp_path), tmp_path / "root"
    root.mkdir()
    done = flashed(path, root)
    assert done.returncode == 0, done.stderr
    command, config = root / "usr/local/bin/mapod", root / "etc/mapod/mapod.toml"
    words = [str(command), "doctor", "--config", str(config)]
    said = subprocess.run(words, capture_output=True, text=True, check=False).stdout
    assert "OK       kernels    all compiled" in said
    assert "OK       libraries  numpy" in said
    assert "OK       settings" in said
    lib = root / "opt/mapod/current/lib"
    assert not list(lib.glob("num*/**/tests")) + list(lib.rglob("*.pyi"))
    assert (lib / "mapod/hw/mcu/mapod_link.h").exists()
    modules = f"import sys; sys.path.insert(0, {str(lib)!r}); import numpy.testing, numba.typed"
    subprocess.run([sys.executable, "-IS", "-c", modules], check=True)
