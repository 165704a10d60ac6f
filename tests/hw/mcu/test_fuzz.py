"""No bytes make the C header reach beyond its memory, or let a rejected frame change the map."""

import re
import subprocess
from pathlib import Path

import pytest

from tests.support.link.c_fuzz import build_replayer, fuzz, random_input, seeds, write_inputs

INPUTS = 700
RUNS = 5_000


@pytest.mark.slow
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_frames_of_arbitrary_bodies_noise_and_damage_do_no_harm_under_sanitizers(
    compiler: str, tmp_path: Path
) -> None:
    program = build_replayer(compiler)
    write_inputs(tmp_path, [*seeds(), *(random_input(seed) for seed in range(100, INPUTS))])
    paths = sorted(map(str, tmp_path.iterdir()))
    done = subprocess.run([str(program), *paths], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{len(paths)} inputs\n"


@pytest.mark.slow
def test_the_fuzzer_finds_nothing_in_a_short_run(tmp_path: Path) -> None:
    done = fuzz(tmp_path / "corpus", f"-runs={RUNS}", "-seed=1")
    assert done.returncode == 0, done.stderr[-3000:]
    executed = re.search(r"number_of_executed_units: (\d+)", done.stderr)
    assert executed is not None
    assert int(executed[1]) >= RUNS
