"""The process's own memory: what it will not need again is given back, what it needs stays.

Locked whole, the process is three times as big: the compiler of the kernels and other libraries, of
which nothing is used once all is loaded, and room that was reserved and never touched. So a page is
locked when it is touched. Arrays of a grid's size are filled as they are made, for that touches
them: `np.zeros` does not. Source: mlock(2), madvise(2), malloc_trim(3), proc_pid_smaps(5).
"""

import ctypes
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4
MADV_DONTNEED = 4
ONLY_LOADED = "libllvmlite", "libcrypto", "libsqlite3", "libgfortran", "libquadmath"  # never called
OF_EVERY_PROCESSOR = "openblas"  # of which little is used
HEADER = re.compile(r"([0-9a-f]+)-([0-9a-f]+) (\S+) \S+ \S+ (\d+) *(.*)")


class Mapping(NamedTuple):
    """Pages that lie side by side, and the file from which they come."""

    start: int
    size: int  # bytes
    path: str  # "" of none
    is_as_in_the_file: bool  # nothing is lost if it is given back

    @property
    def range(self) -> tuple[ctypes.c_void_p, ctypes.c_size_t]:
        return ctypes.c_void_p(self.start), ctypes.c_size_t(self.size)

    def is_of(self, *libraries: str) -> bool:
        return any(name in Path(self.path).name for name in libraries)


def mappings(smaps: str) -> Iterator[Mapping]:
    """All of a process, from the text of its /proc/PID/smaps."""
    for block in re.split(r"\n(?=[0-9a-f]+-)", smaps):
        if found := HEADER.match(block):
            start, end = int(found[1], 16), int(found[2], 16)
            path = found[5] if found[4] != "0" else ""
            own = re.search(r"^Anonymous: +(\d+)", block, re.MULTILINE)
            is_clean = "w" not in found[3] and own is not None and own[1] == "0"
            yield Mapping(start, end - start, path, is_clean and path != "")


def lock_memory() -> bool:
    """Give back what only loading needed, and lock the rest; False where that is not permitted.

    Libraries are read in whole, so that no code waits for the disk when it runs for the first time.
    """
    libc = ctypes.CDLL(None)
    libc.malloc_trim(ctypes.c_size_t(0))
    files = [one for one in mappings(Path("/proc/self/smaps").read_text()) if one.path]
    for one in files:
        if one.is_of(*ONLY_LOADED) and one.is_as_in_the_file:
            libc.madvise(*one.range, MADV_DONTNEED)
    if libc.mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) != 0:
        return False
    for one in files:
        if not one.is_of(*ONLY_LOADED, OF_EVERY_PROCESSOR):
            libc.mlock(*one.range)
    return True
