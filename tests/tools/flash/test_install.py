"""A bundle into a plain folder: versions beside each other, settings, the way back, refusals."""

import ast
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests import ROOT
from tests.tools.flash.stand_in import PYTHON, bundle, flashed, runs, tree
from tools.flash.wheels import Target

pytestmark = pytest.mark.slow


def only_version(root: Path) -> str:
    [folder] = (root / "opt/mapod/versions").iterdir()
    return folder.name


@pytest.fixture(scope="module")
def bundles(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Three versions; the second has a setting that is new."""
    folder = tmp_path_factory.mktemp("bundles")
    return [bundle(folder, 1), bundle(folder, 2, new=("b = 2  # new",)), bundle(folder, 3)]


def test_the_robots_side_imports_the_standard_library_alone() -> None:
    for path in ROOT.glob("tools/flash/robot/*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or "."] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                own = name.startswith("tools.flash.robot.")
                assert own or name.split(".")[0] in sys.stdlib_module_names, f"{path}: {name}"


def test_the_same_contents_give_the_same_bundle_and_others_another(tmp_path: Path) -> None:
    one, again, other = (bundle(tmp_path / str(n), number) for n, number in enumerate((1, 1, 2)))
    assert one.name == again.name != other.name
    assert one.read_bytes() == again.read_bytes()
    with zipfile.ZipFile(one) as archive:
        assert "mapod 0.1: none" in archive.read("licences.txt").decode()
        assert "do as you like" in archive.read("licences.txt").decode()


def test_versions_follow_each_other_and_go_back(bundles: list[Path], tmp_path: Path) -> None:
    first = flashed(bundles[0], tmp_path)
    assert first.returncode == 0, first.stderr
    assert runs(tmp_path) == "app 1 with a"
    one = only_version(tmp_path)
    again = flashed(bundles[0], tmp_path)
    assert "is installed here already" in again.stdout
    second = flashed(bundles[1], tmp_path)
    assert "new setting: b = 2" in second.stdout
    assert "+b = 2  # new" in second.stdout
    assert runs(tmp_path) == "app 2 with a"
    flash = tmp_path / "opt/mapod/flash"
    assert f"before that: {one}" in flashed(flash, tmp_path, action="status").stdout
    back = flashed(flash, tmp_path, action="rollback")
    assert back.returncode == 0, back.stderr
    assert "-b = 2  # new" in back.stdout
    assert runs(tmp_path) == "app 1 with a"
    assert flashed(bundles[2], tmp_path).returncode == 0
    assert runs(tmp_path) == "app 3 with a"
    kept = {path.name for path in (tmp_path / "opt/mapod/versions").iterdir()}
    assert one in kept
    assert len(kept) == 2
    assert not [name for name in tree(tmp_path) if "test_it" in name or ".new" in name]


def test_what_the_user_wrote_stays_and_goes_with_its_version(
    bundles: list[Path], tmp_path: Path
) -> None:
    toml = tmp_path / "etc/mapod/mapod.toml"
    toml.parent.mkdir(parents=True)
    own = "a = 7   # measured\r\n#  by  me\n"
    toml.write_bytes(own.encode())
    (tmp_path / "var/lib/mapod").mkdir(parents=True)
    (tmp_path / "var/lib/mapod/hall.map").write_text("map")
    assert flashed(bundles[0], tmp_path).returncode == 0
    assert toml.is_symlink()
    assert toml.read_bytes() == own.encode()
    toml.write_bytes(f"{own}c = 3\n".encode())  # through the link
    assert flashed(bundles[1], tmp_path).returncode == 0
    assert toml.read_bytes() == f"{own}c = 3\nb = 2  # new\n".encode()
    toml.unlink()
    toml.write_bytes(b"a = 8\n")  # as an editor does that puts a new file in its place
    back = flashed(bundles[1], tmp_path, action="rollback")
    assert "is a link now" in back.stdout
    assert toml.read_bytes() == f"{own}c = 3\n".encode()
    kept = [path.read_bytes() for path in (tmp_path / "etc/mapod/settings").iterdir()]
    assert b"a = 8\n" in kept
    assert f"{own}c = 3\nb = 2  # new\n".encode() in kept
    for path in (
        bundles[2],
        bundles[1],
    ):  # the one that was rolled back from is gone, and comes again
        assert flashed(path, tmp_path).returncode == 0
    assert toml.read_bytes() == f"{own}c = 3\nb = 2  # new\n".encode()
    assert b"a = 8\n" in [path.read_bytes() for path in (tmp_path / "etc/mapod/settings").iterdir()]
    assert (tmp_path / "var/lib/mapod/hall.map").read_text() == "map"


def test_files_of_somebody_else_in_our_places_stay(bundles: list[Path], tmp_path: Path) -> None:
    rules = tmp_path / "etc/udev/rules.d/99-mapod.rules"
    rules.parent.mkdir(parents=True)
    rules.write_text("mine")
    done = flashed(bundles[0], tmp_path)
    assert "/etc/udev/rules.d/99-mapod.rules is not from a flash: it stays" in done.stdout
    assert rules.read_text() == "mine"


def damaged(path: Path, folder: Path) -> Path:
    """The bundle with one byte of its wheel changed."""
    content = bytearray(path.read_bytes())
    content[content.index(b"NUMBER, NEW")] ^= 1
    copy = folder / path.name
    copy.write_bytes(content)
    return copy


def refusals(folder: Path) -> dict[str, tuple[Path, str, tuple[str, ...]]]:
    """Bundle, the words that refuse it, and the options it is flashed with."""
    folder.mkdir()
    good, arch = (
        bundle(folder / "good", 9),
        bundle(folder / "arch", target=Target("riscv64", PYTHON)),
    )
    python = bundle(folder / "python", target=Target(python="312"))
    cut = folder / "cut.pyz"
    cut.write_bytes(good.read_bytes()[:-500])
    return {
        "arch": (arch, "the bundle is for riscv64, this machine is", ()),
        "python": (python, "is for Python 3.12: run it with python3.12", ()),
        "damaged": (damaged(good, folder), "is damaged: wheels/mapod-0.9-py3-none-any.whl", ()),
        "cut": (cut, "cut.pyz", ()),
        "no systemd": (good, "systemd does not run here: --service none", ("--service", "mapod")),
        "kernels": (bundle(folder / "w", fault="warm"), "can't compile the kernels: as it was", ()),
        "check": (bundle(folder / "c", fault="check"), "mapod check: as it was built to", ()),
    }


def test_what_can_not_be_is_refused_in_one_line_and_changes_nothing(
    bundles: list[Path], tmp_path: Path
) -> None:
    root = tmp_path / "root"
    root.mkdir()
    for state in ("fresh", "flashed"):
        before = tree(root)
        for name, (path, words, options) in refusals(tmp_path / state).items():
            done = flashed(path, root, *options)
            assert done.returncode == 1, name
            assert words in done.stderr, name
            assert len(done.stderr.splitlines()) == 1, done.stderr
            if state == "flashed":
                assert tree(root) == before, name
        if state == "fresh":
            assert flashed(bundles[0], root).returncode == 0
    settings = root / "etc/mapod/mapod.toml"
    settings.write_text("unknown = 1\n")
    before = tree(root)
    done = flashed(bundles[1], root)
    assert done.stderr.strip().endswith("do not fit this version: unknown: no such setting")
    assert tree(root) == before


def test_a_second_flash_at_once_is_refused_and_told_who_flashes(
    bundles: list[Path], tmp_path: Path
) -> None:
    assert flashed(bundles[0], tmp_path).returncode == 0
    slow = bundle(tmp_path / "bundles", 7, fault="waits")
    command = [sys.executable, "-IS", str(slow), "install", "--root", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as first:
        try:
            assert first.stdout
            for line in first.stdout:
                if "kernels" in line:
                    break
            done = flashed(bundles[1], tmp_path)
            who = f"another flash is at work: the flash of {slow.name.split('-x')[0][6:]}, process "
            assert done.stderr.startswith(f"mapod flash: {who}{first.pid}, since ")
            assert len(done.stderr.splitlines()) == 1
            told = flashed(tmp_path / "opt/mapod/flash", tmp_path, action="status").stdout
            assert f"a flash is at work: the flash of {slow.name.split('-x')[0][6:]}" in told
            while not (pipes := [*tmp_path.glob("opt/mapod/versions/.staging-*/lib/mapod/pipe")]):
                pass
            pipes[0].write_text("go on")
            first.wait()
        finally:
            first.kill()
    assert first.returncode == 0
    assert runs(tmp_path) == "app 7 with a"


def test_another_root_needs_no_path_of_its_own(bundles: list[Path], tmp_path: Path) -> None:
    """Links hold wherever the root lies."""
    root, moved = tmp_path / "root", tmp_path / "elsewhere"
    root.mkdir()
    assert flashed(bundles[0], root).returncode == 0
    root.rename(moved)
    assert runs(moved) == "app 1 with a"
    for path in moved.rglob("*"):
        assert not path.is_symlink() or path.exists(), path
    named = [
        path
        for path in moved.rglob("*")
        if path.is_file() and re.search(rb"/root/opt", path.read_bytes())
    ]
    assert named == []
