"""The short form of `make fuzz`, the inputs that are kept, and what each target would notice."""

import platform
import re
import subprocess
import sys
from pathlib import Path

import pytest

from mapod_link.asking import DRIVE_BODY, hello_body
from mapod_link.frames import DRIVE, HELLO
from tests import ROOT
from tools.fuzz import corpus, ledger, link, modbus, page
from tools.fuzz.program import instruction, instructions_of
from tools.fuzz.streams import STREAM_BYTES, streams
from tools.fuzz.targets import TARGETS

RUNS = 400
FEWER = {"kinect": 50}  # of 300 000 numbers each
ABLE = [
    pytest.param(name, marks=pytest.mark.skipif(bool(one.lacks), reason=f"needs {one.lacks}"))
    for name, one in TARGETS.items()
]


@pytest.mark.slow
@pytest.mark.skipif(
    platform.machine() != "x86_64",
    reason="the fuzzer has no wheel for this machine's processor",
)
@pytest.mark.parametrize("name", ABLE)
def test_no_bytes_from_outside_raise_hang_or_fill_the_memory(name: str) -> None:
    runs = FEWER.get(name, RUNS)
    command = [sys.executable, "-m", "tools.fuzz", "--target", name]
    found = subprocess.run(
        [*command, "--seconds", "0", "--runs", str(runs)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert found.returncode == 0, found.stderr[-3000:]
    executed = re.search(r"stat::number_of_executed_units: (\d+)", found.stderr)
    assert executed is not None
    assert int(executed[1]) >= runs
    counted = re.search(rf"mapod: {name}: (\d+) inputs", found.stdout)
    assert counted is not None
    assert counted[1] == executed[1]


@pytest.mark.parametrize("name", ABLE)
def test_what_a_fuzzer_has_found_to_be_of_use_does_no_harm(name: str) -> None:
    paths = corpus.kept(name)
    assert paths
    for path in paths:
        TARGETS[name].run(path.read_bytes())


def test_what_is_kept_is_little() -> None:
    kept = {path.parent.name: path for path in corpus.FOLDER.glob("*/*")}
    assert kept.keys() == TARGETS.keys()
    assert sum(path.stat().st_size for path in corpus.FOLDER.glob("*/*")) < 200_000


def test_requests_to_drive_get_through_where_they_are_right(tmp_path: Path) -> None:
    """Else the fuzzer would knock at closed doors: the checks hold because nothing comes in."""
    drive = DRIVE_BODY.pack(link.SESSION, link.NONCE, 300, -200, 400, 0)
    for way, has_key, obeyed in ((1, False, 1), (1, True, 0), (2, True, 1)):
        said = (HELLO, hello_body(link.NONCE, 1000)), (DRIVE, drive)
        heads = [bytes([way | kind << link.TYPE_SHIFT]) for kind, _ in said]
        bodies = [instruction(0, body)[1:] for _, body in said]
        program = b"".join(head + body for head, body in zip(heads, bodies, strict=True))
        assert link.run(program, has_key=has_key) == obeyed
    modbus.write_seeds(tmp_path)
    assert modbus.run((tmp_path / "all-tcp").read_bytes()) == 2
    assert modbus.run((tmp_path / "all-far").read_bytes()) == 0
    page.write_seeds(tmp_path)
    assert page.run((tmp_path / f"page-{page.UPGRADE | page.WITH_TOKEN}").read_bytes()) == 1
    assert page.run((tmp_path / f"said-{page.UPGRADE}-3").read_bytes()) == 0


@pytest.mark.parametrize(("name", "least"), [("settings", 18), ("recording", 20), ("map", 30)])
def test_seeds_of_files_are_read(name: str, least: int, tmp_path: Path) -> None:
    TARGETS[name].write_seeds(tmp_path)
    assert sum(TARGETS[name].run(path.read_bytes()) > 0 for path in tmp_path.iterdir()) >= least


def test_long_inputs_are_programs_that_are_run_to_their_end() -> None:
    seeds = [instruction(0, b"\x02abc\x03") + instruction(1, b"\x07" * 40)]
    made = [next(streams(seeds, seed, 100, joined)) for seed, joined in ((1, 0), (1, 512), (2, 0))]
    assert made[0] == next(streams(seeds, 1, 100, 0))
    assert made[0] != made[2]
    for program in made:
        steps = list(instructions_of(program, 1000))
        assert len(program) <= STREAM_BYTES
        assert len(steps) <= 100
        assert sum(3 + len(data) for _, data in steps) == len(program)
    assert len(made[1]) > 2 * len(made[0])


def test_the_fewest_inputs_take_every_step() -> None:
    right = instruction(modbus.FRAMED, bytes.fromhex("01 03 00 00 00 0a"))
    chosen = corpus.fewest("modbus", [right, right + right[:7], right + right, b""])
    assert chosen[-1] in (right, right + right[:7])
    assert right + right not in chosen


def test_what_was_run_is_added_up(tmp_path: Path) -> None:
    path, tally = tmp_path / "fuzz.json", ledger.Tally.at(tmp_path / "tally")
    tally.add(10)
    tally.add(2)
    assert ledger.counted(tmp_path / "tally") == (2, 12)
    ledger.note("mti", ledger.GUIDED, 2, 12, 1.4, path)
    ledger.note("mti", ledger.STREAMS, 1, 65_536, 2.0, path)
    ledger.note("mti", ledger.STREAMS, 1, 65_536, 2.0, path)
    told = ledger.table(ledger.read(path), {"mti": "sensor", "map": "maps"}).splitlines()
    assert told[2] == "| sensor | 4 | 131 084 | 131 072 | 5 |"
    assert told[3] == "| maps | 0 | 0 | 0 | 0 |"
    assert told[-1] == "| all | 4 | 131 084 | 131 072 | 5 |"
    text = f"before\n\n{ledger.HEADING}\n| old |\n\nbehind\n"
    new = "\n".join(told)
    assert ledger.renewed(text, new) == f"before\n\n{new}\n\nbehind\n"


def test_the_document_has_the_table_of_what_was_run() -> None:
    words = {name: one.what for name, one in TARGETS.items()}
    written = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    assert ledger.table(ledger.read(), words) in written, "python -m tools.fuzz --count"
