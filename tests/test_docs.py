"""The documents are true: files, targets, settings and commands that they name exist."""

import re
from pathlib import Path

from config_file import load_config
from tools.docs.files import file_list

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
ARCHITECTURE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
DEVICES = (ROOT / "docs" / "devices.md").read_text(encoding="utf-8")
MAPS = (ROOT / "docs" / "maps.md").read_text(encoding="utf-8")
LINK = (ROOT / "docs" / "protocols" / "planner-link.md").read_text(encoding="utf-8")
MODBUS = (ROOT / "docs" / "protocols" / "modbus.md").read_text(encoding="utf-8")
RIG = (ROOT / "docs" / "rig.md").read_text(encoding="utf-8")
FAULTS = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")


def test_the_list_of_files_is_what_the_files_say() -> None:
    assert (ROOT / "docs" / "files.md").read_text(encoding="utf-8") == file_list()


def test_prose_ends_before_column_110() -> None:
    written = {*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), ROOT / "tests/vectors/README.md"}
    for path in sorted(written - {ROOT / "docs" / "files.md"}):  # which is made from the files
        is_code = False
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            is_code ^= line.startswith("```")
            is_prose = not is_code and not line.startswith(("|", "    ", "#"))
            assert not is_prose or len(line) <= 110, f"{path.name}:{number}"


def test_files_that_the_documents_name_exist() -> None:
    for text in (README, ARCHITECTURE, DEVICES, MAPS, LINK, MODBUS, RIG, FAULTS):
        for name in re.findall(r"`((?:docs|core|hw|fakes|tools|tests)/[\w./*]+)`", text):
            assert list(ROOT.glob(name)), name


def test_make_targets_that_the_documents_name_exist_and_help_tells_them() -> None:
    targets = set(re.findall(r"^([a-z-]+):.*## ", MAKEFILE, re.MULTILINE))
    for text in (README, RIG):
        named = re.findall(r"(?:`|^ {4})make\s([a-z][a-z-]*)", text, re.MULTILINE)
        assert named
        assert set(named) <= targets


def test_the_shipped_settings_load_and_each_has_a_comment_or_a_group_that_has() -> None:
    text = (ROOT / "mapod.toml").read_text(encoding="utf-8")
    load_config(text)
    settings = [line for line in text.splitlines() if re.match(r"\w+ = ", line)]
    assert len(settings) > 40
    assert sum("#" in line for line in settings) > 0.8 * len(settings)


def test_no_file_names_a_path_of_some_machine() -> None:
    for path in [*ROOT.glob("*.*"), *ROOT.glob("*/*.py"), *ROOT.glob("docs/*"), ROOT / "Makefile"]:
        if path.is_file() and path.name != "test_docs.py":
            text = path.read_text(encoding="utf-8", errors="replace")
            assert not re.search(r"(?<![\w/])/(?:home|root|work)/\w", text), path
