"""What compiles a kernel anew, and what does not: no map is drawn by the code of yesterday."""

import os
import shutil
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from numba.core.errors import TypingError

from core.records import F64
from jit import COMPILED, Settled, kernel, releasing_kernel
from tests import Patch
from tests.support.machine.plain_user import as_plain_user

LOW = '''
from typing import NamedTuple
from jit import kernel

GAIN = 3
OFFSET = (1.0, 2.0)

class Pair(NamedTuple):
    first: float
    second: float

@kernel
def scaled(x: float, times: int) -> float:
    """As it is."""
    return x * GAIN * times

@kernel
def aside(x: float) -> float:
    return x
'''
HIGH = '''
from jit import kernel
from low import OFFSET, Pair, scaled

@kernel
def total(pair: Pair) -> float:
    """A sum."""
    return scaled(pair.first, 2) + pair.second + OFFSET[0]
'''


def tried(folder: Path, low: str = LOW, high: str = HIGH) -> tuple[float, int]:
    """What `total` gives for (10, 100) when it is loaded anew, and how many kernels compiled."""
    with pytest.MonkeyPatch.context() as patch:
        for name, text in (("low", low), ("high", high)):
            (folder / f"{name}.py").write_text(text, encoding="utf-8")
            patch.setitem(sys.modules, name, ModuleType(name))
            exec(compile(text, folder / f"{name}.py", "exec"), vars(sys.modules[name]))
        total, scaled = sys.modules["high"].total, sys.modules["low"].scaled
        result = total(sys.modules["low"].Pair(10.0, 100.0))
    return result, sum(len(kernel.stats.cache_misses) for kernel in (total, scaled))


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kernels")
    assert tried(folder) == (161.0, 2)
    return folder


@pytest.fixture
def copied(compiled: Path, tmp_path: Path) -> Path:
    """A copy of it, with other file times."""
    return Path(shutil.copytree(compiled, tmp_path / "copy", copy_function=shutil.copyfile))


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("", ""),
        ('"""As it is."""', '"""As it has\n    to be."""'),
        ('"""A sum."""', '"""The sum."""  # of two'),
        ("GAIN = 3", "# thrice\n\n\nGAIN = 3"),
        ("    return x\n", "    return x + 1\n"),
        ("from jit import kernel\n", "import math\nfrom jit import kernel\n"),
    ],
)
def test_what_means_the_same_compiles_nothing(copied: Path, before: str, after: str) -> None:
    assert before in LOW + HIGH
    changed = [text.replace(before, after) for text in (LOW, HIGH)]
    assert tried(copied, *changed) == (161.0, 0)


@pytest.mark.parametrize(
    ("before", "after", "result", "count"),
    [
        ("GAIN = 3", "GAIN = 4", 181.0, 2),  # in the other file, used by a kernel there
        ("(1.0, 2.0)", "(0.5, 2.0)", 160.5, 1),  # in the other file, used here
        ("x * GAIN", "x + GAIN", 117.0, 2),
        ("+ pair.second", "- pair.second", -39.0, 1),
        ("first, 2)", "first, 5)", 251.0, 1),
        ("first: float\n    second:", "second: float\n    first:", 611.0, 1),
    ],
)
def test_a_change_compiles_what_it_reaches(
    copied: Path, before: str, after: str, result: float, count: int
) -> None:
    changed = [text.replace(before, after) for text in (LOW, HIGH)]
    kept = len(list(copied.rglob("*.nb?")))
    assert tried(copied, *changed) == (result, count)
    assert len(list(copied.rglob("*.nb?"))) == kept  # what the kernels were before is gone
    assert tried(copied) == (161.0, count)


def test_of_a_module_a_kernel_reaches_what_it_names(tmp_path: Path) -> None:
    high = HIGH.replace("from low import OFFSET, Pair, scaled", "import low")
    for name in ("OFFSET", "Pair", "scaled"):
        high = high.replace(name, f"low.{name}")
    assert tried(tmp_path, LOW, high) == (161.0, 2)
    assert tried(tmp_path, LOW.replace("return x\n", "return x + 1\n"), high) == (161.0, 0)
    assert tried(tmp_path, LOW.replace("(1.0, 2.0)", "(0.5, 2.0)"), high) == (160.5, 1)
    assert tried(tmp_path, LOW.replace("GAIN = 3", "GAIN = 4"), high) == (181.0, 2)


def test_the_user_s_cache_is_taken_where_the_folder_can_not_be_written(
    tmp_path: Path, monkeypatch: Patch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    (tmp_path / "__pycache__").write_text("no folder")
    assert tried(tmp_path) == (161.0, 2)
    assert tried(tmp_path) == (161.0, 0)
    assert len(list((tmp_path / "home").rglob("*.nbc"))) == 2


def test_whole_numbers_of_any_width_and_value_share_one_machine_code(tmp_path: Path) -> None:
    calls = "scaled(pair.first, 2) + 0 * scaled(1.0, 0) + 0 * scaled(1.0, np.int8(pair.first))"
    high = HIGH.replace("scaled(pair.first, 2)", calls).replace(
        "from jit", "import numpy as np\nfrom jit"
    )
    assert tried(tmp_path, LOW, high) == (161.0, 2)


@pytest.mark.parametrize(
    ("before", "after", "error"),
    [
        ("* GAIN", "* LATER", "scaled uses LATER, which is nowhere"),
        ("GAIN = 3", "GAIN = [3]", r"scaled uses \[3\]: a kernel may use numbers"),
    ],
)
def test_what_can_t_be_followed_is_refused(
    tmp_path: Path, before: str, after: str, error: str
) -> None:
    with pytest.raises((NameError, TypeError), match=error):
        tried(tmp_path, LOW.replace(before, after))


GIVING = """
import numpy as np
import numpy.typing as npt
from jit import allocating_kernel, kernel

@allocating_kernel
def pair_of(x: float) -> npt.NDArray[np.float64]:
    return np.array([x, x])

@allocating_kernel
def scaled(x: float, times: int) -> float:
    return pair_of(x).sum() * 3 * times / 2
"""
USES = "def scaled(x: float, times: int) -> float:\n    return pair_of"


def test_a_kernel_that_makes_arrays_says_so(tmp_path: Path) -> None:
    low = LOW.replace("@kernel\ndef aside", GIVING + "\n@kernel\ndef aside")
    assert tried(tmp_path, low) == (161.0, 2)
    silent = low.replace(f"@allocating_kernel\n{USES}", f"@kernel\n{USES}")
    with pytest.raises(TypeError, match="scaled is given an array by pair_of: it is an allocating"):
        tried(tmp_path, silent)
    with pytest.raises(TypeError, match="pair_of gives an array back: it is an allocating kernel"):
        tried(tmp_path, low.replace("@allocating_kernel\ndef pair_of", "@kernel\ndef pair_of"))
    making = LOW.replace("x * GAIN * times", "np.zeros(1)[0] + x").replace(
        "GAIN", "import numpy as np\nGAIN", 1
    )
    with pytest.raises(TypingError, match="zeros"):
        tried(tmp_path, making)


def test_saying_that_it_makes_arrays_compiles_it_anew(copied: Path) -> None:
    low = LOW.replace("@kernel\ndef scaled", "@allocating_kernel\ndef scaled")
    assert tried(copied, low.replace("import kernel", "import allocating_kernel, kernel")) == (
        161.0,
        2,
    )


def test_code_that_lies_where_nobody_may_write_is_used_and_what_can_t_be_kept_is_compiled_again(
    copied: Path, monkeypatch: Patch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/nothing can be made here")
    (copied / "__pycache__").chmod(0o555)
    assert as_plain_user(lambda: tried(copied)) == "(161.0, 0)"
    for path in copied.rglob("*.nbc"):
        path.unlink()  # of which the index still knows
    assert as_plain_user(lambda: tried(copied)) == "(161.0, 2)"
    (copied / "__pycache__").chmod(0o755)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.999])
@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_what_a_power_cut_has_left_damaged_is_compiled_anew(
    copied: Path, kind: str, share: float
) -> None:
    damaged = list(copied.rglob(f"*.{kind}"))
    assert len(damaged) == 2
    for path in damaged:
        os.truncate(path, int(share * path.stat().st_size))
    assert tried(copied) == (161.0, 2)
    assert tried(copied) == (161.0, 0)


def test_a_file_has_its_name_only_once_it_is_on_the_disk(
    tmp_path: Path, monkeypatch: Patch
) -> None:
    flushed: dict[int, int] = {}  # bytes, by inode
    named = set[tuple[str, bool]]()  # and whether all of it was flushed

    def fsync(handle: int) -> None:
        flushed[os.fstat(handle).st_ino] = os.fstat(handle).st_size

    def replace(old: str, new: str) -> None:
        there = os.stat(old)
        named.add((Path(new).suffix, flushed.get(there.st_ino) == there.st_size > 0))
        os.rename(old, new)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(os, "replace", replace)
    assert tried(tmp_path) == (161.0, 2)
    assert named == {(".nbi", True), (".nbc", True)}


@kernel
def _summed(values: F64, more: tuple[float, int]) -> float:
    return float(values.sum()) + more[0] * more[1]


def test_a_settled_kernel_does_what_the_kernel_does() -> None:
    values = np.array([1.0, 2.0])
    run = Settled(_summed)
    assert run(values, (0.5, 2)) == _summed(values, (0.5, 2))
    for third in (3.0, -7.5):
        given = np.array([1.0, 2.0, third]), (third, 3)
        assert run(*given) == _summed(*given)


def test_a_releasing_kernel_lets_go_of_the_lock_and_another_does_not() -> None:
    def twice(x: float) -> float:
        return 2.0 * x

    holds, lets_go = kernel(twice), releasing_kernel(twice)
    if not COMPILED:
        return
    assert isinstance(holds, Dispatcher)
    assert isinstance(lets_go, Dispatcher)
    assert "nogil" not in holds.targetoptions
    assert lets_go.targetoptions["nogil"]
    assert lets_go(2.0) == 4.0
