"""What is given back can come again, what was changed stays, and libraries are there as a whole."""

import json
import subprocess
import sys

from hw.runtime.memory import ONLY_LOADED, mappings
from tests import ROOT

SMAPS = """\
55d0c0a00000-55d0c0a21000 rw-p 00000000 00:00 0                          [heap]
Size:                132 kB
Anonymous:            80 kB
7f0000000000-7f0000100000 r-xp 00a00000 fe:00 4711                       /opt/a b/libllvmlite.so
Anonymous:             0 kB
7f0000100000-7f0000200000 r--p 00b00000 fe:00 4711                       /opt/a b/libllvmlite.so
Anonymous:             4 kB
7f0000200000-7f0000300000 rw-p 00c00000 fe:00 4711                       /opt/a b/libllvmlite.so
Anonymous:             0 kB
7f0000300000-7f0000304000 r--p 00000000 00:00 0
Anonymous:             0 kB
"""
LOCKED_AND_WENT_ON = """
import json, re, numba
from pathlib import Path
from hw.runtime.memory import lock_memory

def kilobytes(library, name):
    blocks = re.split(r"\\n(?=[0-9a-f]+-)", Path("/proc/self/smaps").read_text())
    lines = [line for block in blocks if library in block for line in block.splitlines()]
    return sum(int(line.split()[1]) for line in lines if line.startswith(name + ":"))

compiled = numba.njit(lambda x: x + 1)
results, before = [compiled(1)], kilobytes("libllvmlite", "Rss")
locked = lock_memory()
kept = kilobytes("libllvmlite", "Rss")
whole = kilobytes("_multiarray_umath", "Rss") == kilobytes("_multiarray_umath", "Size")
results += [compiled(2), compiled(0.5)]  # the last one is compiled now
print(json.dumps([before, kept, results, locked, whole]))
"""


def test_only_what_is_as_in_its_file_may_be_given_back() -> None:
    heap, code, relocated, data, nameless = mappings(SMAPS)
    assert (heap.path, nameless.path) == ("", "")
    assert (code.start, code.size) == (0x7F0000000000, 0x100000)
    assert all(one.is_of(*ONLY_LOADED) for one in (code, relocated, data))
    clean = [one.is_as_in_the_file for one in (heap, code, relocated, data, nameless)]
    assert clean == [False, True, False, False, False]


def test_the_compiler_is_given_back_and_comes_again_when_it_is_needed() -> None:
    command = [sys.executable, "-c", LOCKED_AND_WENT_ON]
    out = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, check=True).stdout
    before, kept, results, locked, whole = json.loads(out)
    assert results == [2, 3, 1.5]
    assert kept < before / 10
    assert whole == locked
