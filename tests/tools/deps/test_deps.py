"""The lock holds all that pyproject.toml names, with hashes; the bill of materials is its own."""

import json
from importlib import metadata

import pytest

from tests import ROOT, Capsys, Patch
from tools.deps import lock, sbom
from tools.deps.lock import LockError, Pin, closure, pins_from_text, wanted_of

PINS = pins_from_text(lock.FILE.read_text(encoding="utf-8"))
HASH = "    --hash=sha256:" + 64 * "a"


def test_every_extra_is_locked_with_all_that_it_needs() -> None:
    project = lock.project()
    every = lock.locked(*project["optional-dependencies"])
    assert {pin.name for pin in every} == set(PINS)
    for pin in every:
        assert all(len(digest) == 64 for digest in pin.hashes)
        assert set(pin.needed_by) <= PINS.keys() | {"mapod"}
    assert {pin.name for pin in lock.locked()} >= {"numpy", "numba", "llvmlite", "msgspec"}
    assert "pytest" not in {pin.name for pin in lock.locked()}


def test_the_lock_is_of_the_needs_that_pyproject_names() -> None:
    """Each version that is locked lies within the bounds there; who changed them locks anew."""
    requirements = pytest.importorskip("packaging.requirements")
    project = lock.project()
    lines = [*project["dependencies"]]
    lines += [line for extra in project["optional-dependencies"].values() for line in extra]
    for line in lines:
        wanted = requirements.Requirement(line)
        if wanted.name == lock.OWN:  # an extra of several
            continue
        pin = PINS[lock.normal(wanted.name)]
        assert wanted.specifier.contains(pin.version), f"{line}: {pin.version}; make lock"


def test_what_the_libraries_that_are_installed_need_is_locked_as_theirs() -> None:
    requirements = pytest.importorskip("packaging.requirements")
    for pin in lock.locked():
        for line in metadata.requires(pin.name) or []:
            need = requirements.Requirement(line)
            if need.marker is None or need.marker.evaluate({"extra": ""}):
                assert pin.name in PINS[lock.normal(need.name)].needed_by


def test_what_pip_gets_is_pinned_and_hashed(capsys: Capsys, monkeypatch: Patch) -> None:
    monkeypatch.setattr("sys.argv", ["lock", "objects"])
    assert lock.main() == 0
    out = capsys.readouterr().out
    assert "shapely==" in out
    for line in out.splitlines():
        assert "==" in line or line.startswith("    --hash=sha256:")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("numpy>=2\n", "no line of a lock"),
        ("numpy==2.4.6\n    # via mapod\n", "numpy has no hash"),
        (f"numpy==2.4.6 \\\n{HASH}\n", "nobody needs it"),
        ("--index-url http://10.0.0.1/\n", "no line of a lock"),
        (f"numpy==2.4.6 \\\n    --hash=md5:{32 * 'a'}\n    # via mapod\n", "no line of a lock"),
    ],
)
def test_what_is_no_lock_is_refused(text: str, words: str) -> None:
    with pytest.raises(LockError, match=words):
        pins_from_text(text)


def test_what_is_not_there_is_named(capsys: Capsys, monkeypatch: Patch) -> None:
    with pytest.raises(LockError, match="no extra 'sims'; there are sim, "):
        wanted_of(lock.project(), ["sims"])
    with pytest.raises(LockError, match="nothing is missing: make lock"):
        closure({"a": Pin("a", "1", "", ["0"], ["mapod"])}, ["nothing"])
    monkeypatch.setattr("sys.argv", ["lock", "sims"])
    assert lock.main() == 1
    assert capsys.readouterr().err.startswith("mapod: there is no extra 'sims'")


def test_the_bill_of_materials_is_that_of_the_lock() -> None:
    assert sbom.WRITTEN.read_text(encoding="utf-8") == sbom.text(), "make sbom"
    told = json.loads(sbom.text())
    refs = {one["bom-ref"] for one in told["components"]}
    assert len(refs) == len(told["components"]) == len(PINS)
    refs.add(told["metadata"]["component"]["bom-ref"])
    assert {one["ref"] for one in told["dependencies"]} == refs
    assert all(refs >= set(one["dependsOn"]) for one in told["dependencies"])
    numpy = next(one for one in told["components"] if one["name"] == "numpy")
    assert (numpy["scope"], numpy["purl"]) == (
        "required",
        f"pkg:pypi/numpy@{PINS['numpy'].version}",
    )


def test_make_installs_nothing_that_is_not_locked() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    installs = [line for line in makefile.splitlines() if "pip install" in line]
    free = [line for line in installs if "--require-hashes" not in line]
    assert [line.rsplit('"')[-2] for line in free] == [
        "uv>=0.9,<1",
        "pip-audit>=2.9,<3",
        "pyoctomap>=1.2,<2",
        "open3d>=0.19,<1",
        "coverage-path-planner>=1.4,<2",
    ]
