"""The documents are true: files, targets, settings and commands that they name exist."""

import importlib
import re

from config_file import load_config
from core.mapping.layers import UNITS
from tests import ROOT, VECTORS
from tools.docs.files import file_list

WRITTEN = {  # all but what is made from the files
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for path in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *VECTORS.glob("*.md")]
    if path.name != "files.md"
}


def test_the_list_of_files_is_what_the_files_say() -> None:
    assert (ROOT / "docs" / "files.md").read_text(encoding="utf-8") == file_list()


def test_prose_ends_before_column_110() -> None:
    for name, text in WRITTEN.items():
        is_code = False
        for number, line in enumerate(text.splitlines(), 1):
            is_code ^= line.startswith("```")
            is_prose = not is_code and not line.startswith(("|", "    ", "#"))
            assert not is_prose or len(line) <= 110, f"{name}:{number}"


def test_files_that_the_documents_name_exist() -> None:
    for text in WRITTEN.values():
        for name in re.findall(r"`((?:docs|core|hw|fakes|tools|tests)/[\w./*]+)`", text):
            assert list(ROOT.glob(name)), name


def test_make_targets_that_the_documents_name_exist_and_help_tells_them() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):.*## ", makefile, re.MULTILINE))
    for text in (WRITTEN["README.md"], WRITTEN["docs/rig.md"]):
        named = re.findall(r"(?:`|^ {4})make\s([a-z][a-z-]*)", text, re.MULTILINE)
        assert named
        assert set(named) <= targets


def test_the_shipped_settings_load_and_each_has_a_comment_or_a_group_that_has() -> None:
    text = (ROOT / "mapod.toml").read_text(encoding="utf-8")
    load_config(text)
    settings = [line for line in text.splitlines() if re.match(r"\w+ = ", line)]
    assert len(settings) > 40
    assert sum("#" in line for line in settings) > 0.8 * len(settings)


def test_every_layer_that_can_be_exported_is_named() -> None:
    words = re.findall(r"`(?:--layer )?(\w+)`", WRITTEN["docs/export.md"])
    assert UNITS.keys() <= set(words)


def test_no_file_names_a_path_of_some_machine() -> None:
    for path in [*ROOT.glob("*.*"), *ROOT.glob("*/*.py"), *ROOT.glob("docs/*"), ROOT / "Makefile"]:
        if path.is_file() and path.name != "test_docs.py":
            text = path.read_text(encoding="utf-8", errors="replace")
            assert not re.search(r"(?<![\w/])/(?:home|root|work)/\w", text), path


def test_tests_that_the_documents_name_exist() -> None:
    named = [
        place
        for text in WRITTEN.values()
        for place in re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", text)
    ]
    assert len(named) > 20
    for file, name in named:
        assert f"\ndef {name}(" in (ROOT / file).read_text(encoding="utf-8"), f"{file}::{name}"


def test_the_constants_of_safe_states_are_those_of_the_code() -> None:
    rows = re.findall(
        r"^\| `(\w+)` \| `([\w/]+)\.py` \| ([\d.]+) \|", WRITTEN["docs/safety.md"], re.M
    )
    assert len(rows) > 20
    for name, file, value in rows:
        module = importlib.import_module(file.replace("/", "."))
        assert getattr(module, name) == float(value), name
