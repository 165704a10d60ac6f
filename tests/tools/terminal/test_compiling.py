"""Who waits for a process waits longer while it compiles, and says why."""

from pathlib import Path

from tests import Patch
from tools.terminal.compiling import COMPILING, Patience


def test_each_new_kernel_is_told_once_and_prolongs_the_wait(
    tmp_path: Path, monkeypatch: Patch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    told: list[str] = []
    (tmp_path / "old.nbc").touch()
    patience = Patience(100.0, 60.0, told.append)
    assert not patience.is_over(159.0)
    assert told == []
    for number in range(2):
        (tmp_path / f"new{number}.nbc").touch()
        assert not patience.is_over(161.0 + number)
    assert told == [COMPILING]
    assert not patience.is_over(222.0)
    assert patience.is_over(222.5)
