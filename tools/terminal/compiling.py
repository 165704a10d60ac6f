"""Patience with processes of ours that compile kernels first: seen by what that leaves on disk."""

import os
from collections.abc import Callable
from pathlib import Path

from tools.cli.options import ROOT

ROOMS = ("core", "fakes", "hw")  # which have kernels
LOOK_S = 1.0
COMPILING = (
    "kernels are being compiled, once: it may take minutes; `make setup` does it ahead of time"
)


def kernels_on_disk() -> set[str]:
    """Files of compiled kernels, of this version or an earlier one."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    folders = [Path(given)] if given else [ROOT / room for room in ROOMS]
    return {str(path) for folder in folders for path in folder.rglob("*.nbc")}


class Patience:
    """How long something is waited for; anew with each kernel that has been compiled meanwhile.

    Args:
        tell: is told once that kernels are being compiled.
    """

    def __init__(self, now_s: float, seconds: float, tell: Callable[[str], None]) -> None:
        self._seconds, self._tell = seconds, tell
        self._kernels, self._is_told = kernels_on_disk(), False
        self._look_s, self._overdue_s = now_s, now_s + seconds

    def is_over(self, now_s: float) -> bool:
        if now_s < min(self._look_s, self._overdue_s):
            return False
        self._look_s, kernels = now_s + LOOK_S, kernels_on_disk()
        if kernels - self._kernels:
            self._kernels, self._overdue_s = kernels, now_s + self._seconds
            if not self._is_told:
                self._is_told = True
                self._tell(COMPILING)
        return now_s > self._overdue_s
