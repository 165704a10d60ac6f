"""The public Python receiver with one line changed: the conformance tests find each change.

A line that is not there any more fails as well: then the change below is to be put where it went.
"""

import importlib
import shutil
import sys
from pathlib import Path
from types import ModuleType

import pytest

import mapod_link
from tools.conformance.exam import Exam
from tools.conformance.in_process import InProcess
from tools.conformance.suite import chosen, meet, run

SOURCE = Path(mapod_link.__file__).parent
MUTANTS = [  # the test that must find it, line, what it becomes
    ("5", "int16(repaired - self.gap) >= 0", "int16(repaired - self.gap) > 0"),
    ("5", "int16(repaired - self.gap) >= 0", "repaired >= self.gap"),
    ("5", "if step > 1:", "if step > 2:"),
    ("5", "int16(frame.seq - self.last) > 0", "frame.seq > self.last"),
    ("5", "self.gap = frame.seq - 1", "self.gap = self.last + 1"),
    ("15", "return self.any and SILENCE_MS", "return False and SILENCE_MS"),
    ("2", "int16(ox - old_x), int16(oy - old_y)", "ox - old_x, oy - old_y"),
    ("2", "abs(dx) >= width", "abs(dx) >= 1"),
    ("2", "max(step, 0), max(-step, 0)", "max(-step, 0), max(step, 0)"),
    ("2", "if state != KEEP:", "if True:"),
    ("3", "if zlib.crc32(content, CRC_START) != int", "if 0 > int"),
    ("4", "if flags & RESERVED_FLAGS:", "if flags & 0x20:"),
    ("6", "self.pose = self.stop_zone = None", "self.stop_zone = None"),
    ("6", "min(self.pose.arrived_s, self.numbers.map_s)", "self.pose.arrived_s"),
    ("6", "min(self.pose.arrived_s, self.numbers.map_s)", "self.numbers.map_s"),
    ("2", "self.digest() == digest.crc", "True"),
]


def mutant(folder: Path, name: str, line: str, becomes: str) -> ModuleType:
    """The receiver's module in a copy of the package with one line changed."""
    package, found = folder / name, 0
    shutil.copytree(SOURCE, package, ignore=shutil.ignore_patterns("__pycache__"))
    for path in package.glob("*.py"):
        text = path.read_text(encoding="utf-8")
        found += text.count(line)
        text = text.replace(line, becomes).replace("mapod_link", name)
        path.write_text(text, encoding="utf-8")
    assert found == 1, f"{line}: stands in {found} places"
    importlib.invalidate_caches()
    sys.path.insert(0, str(folder))
    try:
        return importlib.import_module(f"{name}.receiver")
    finally:
        sys.path.remove(str(folder))


@pytest.mark.parametrize("number", range(len(MUTANTS)))
def test_one_changed_line_of_the_receiver_is_found_by_its_answers(
    number: int, tmp_path: Path
) -> None:
    check, line, becomes = MUTANTS[number]
    module = mutant(tmp_path, f"mutant_{number}", line, becomes)
    exam = Exam(InProcess(lambda start: module.Receiver(9 + start), shows_cells=False), share=0.1)
    assert meet(exam) == ""
    checks = [one for one in chosen(check) if "mapod's sender" not in one.name]
    assert any(verdict.failure for verdict in run(exam, checks, seed=1))
