"""The C header as an examinee in process: hw/mcu/host/library.c, built by the host's compiler.

Only what the conformance runs need; times are whole milliseconds there.
"""

import ctypes
import functools
import hashlib
import math
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np

from tools.conformance.wire import U8

MCU = Path(__file__).resolve().parents[2] / "hw" / "mcu"
COMPILERS = ("gcc", "clang", "cc")
MAX_OUT = 64  # bytes of the longest answer


class NoCompilerError(Exception):
    """The header can't be built here."""


class State(ctypes.Structure):
    """`struct state` of library.c: everything small that a receiver knows."""

    _fields_ = (
        *((name, ctypes.c_uint32) for name in ("session", "mask", "newest_t_ms", "newest_piece")),
        *((n, ctypes.c_uint16) for n in ("width", "height", "cell_mm", "tick_ms", "stale_ms")),
        *((name, ctypes.c_uint16) for name in ("last", "gap", "bad_frames")),
        *((name, ctypes.c_int16) for name in ("ox", "oy")),
        *((n, ctypes.c_uint8) for n in ("geom_id", "has_geom", "has_pose", "blank", "suspect")),
        *((n, ctypes.c_uint8) for n in ("stale", "any", "need_geom", "need_full", "digest_ok")),
        *((name, ctypes.c_uint8) for name in ("auth_failed", "advice", "why", "zone_advice")),
    )


@functools.cache
def library() -> ctypes.CDLL:
    """The header as a shared library, built where its sources have changed.

    Raises:
        NoCompilerError: there is no C compiler.
        OSError: it does not compile.
    """
    source = MCU / "host" / "library.c"
    sources = [*sorted(MCU.glob("*.h")), source, Path(__file__)]
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]
    path = MCU / "build" / f"conformance-{digest}.so"
    if not path.exists():
        found = [program for program in COMPILERS if shutil.which(program)]
        if not found:
            raise NoCompilerError("the C receiver needs a C compiler: apt install gcc")
        path.parent.mkdir(parents=True, exist_ok=True)
        made = path.with_suffix(f".{os.getpid()}")
        options = ["-std=c99", "-O2", "-shared", "-fPIC", f"-I{MCU}", "-o", str(made)]
        options.append("-DMAPOD_LINK_LEFT_SESSIONS=65536u")  # an exam is full of new runs
        built = subprocess.run([found[0], *options, str(source)], capture_output=True)
        if built.returncode:
            raise OSError(f"{source} does not compile: {built.stderr.decode()}")
        os.replace(made, path)
    return _typed(ctypes.CDLL(str(path)))


def _typed(lib: ctypes.CDLL) -> ctypes.CDLL:
    """The calls' types."""
    handle, u32, data = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_char_p
    lib.receiver_new.argtypes, lib.receiver_new.restype = [u32, u32, data, ctypes.c_int], handle
    lib.receiver_free.argtypes = [handle]
    lib.receiver_datagram.argtypes = [handle, u32, data, u32]
    lib.receiver_stream.argtypes = [handle, u32, data, u32, ctypes.POINTER(ctypes.c_int)]
    lib.receiver_stream.restype = u32
    lib.receiver_window.argtypes = [handle, ctypes.c_void_p]
    lib.receiver_poll.argtypes, lib.receiver_poll.restype = [handle, u32, data], u32
    lib.receiver_say.argtypes = [handle, ctypes.c_int, ctypes.c_int]
    lib.receiver_state.argtypes = [handle, u32, ctypes.POINTER(State)]
    return lib


class CReceiver:
    """The C header's receiver, with the calls that all receivers in process have."""

    def __init__(self, nonce: int, *, key: bytes | None = None, max_cells: int = 401 * 401) -> None:
        self._lib = library()
        self.nonce = nonce
        self._handle = self._lib.receiver_new(max_cells, nonce, key, 0)
        self._state, self._out = State(), ctypes.create_string_buffer(MAX_OUT)
        self._now_ms = 0
        self._cells: U8 = np.zeros((0, 0), np.uint8)

    def __del__(self) -> None:
        if getattr(self, "_handle", None):
            self._lib.receiver_free(self._handle)

    def feed_datagram(self, now_s: float, data: bytes) -> None:
        """One frame."""
        self._lib.receiver_datagram(self._handle, self._ms(now_s), data, len(data))

    def feed_stream(self, now_s: float, data: bytes) -> None:
        """Bytes of a serial line, cut anywhere."""
        outcome, now_ms = ctypes.c_int(), self._ms(now_s)
        while data:
            size = len(data)
            used = self._lib.receiver_stream(
                self._handle, now_ms, data, size, ctypes.byref(outcome)
            )
            data = data[used:]

    def poll(self, now_s: float) -> list[bytes]:
        """Frames to send; the header decides when."""
        frames, now_ms = [], self._ms(now_s)
        while size := self._lib.receiver_poll(self._handle, now_ms, self._out):
            frames.append(self._out.raw[:size])
        return frames

    def want_full(self) -> None:
        """Ask for a new epoch with the next ACK."""
        self._lib.receiver_say(self._handle, 1, 1)

    def window(self) -> U8:
        """(height, width) copy of all cells."""
        return self.cells.copy()

    @property
    def cells(self) -> U8:
        """(height, width) of all cells; the next call overwrites it."""
        state = self.state()
        shape = (state.height, state.width) if state.has_geom else (0, 0)
        if self._cells.shape != shape:
            self._cells = np.zeros(shape, np.uint8)
        if self._cells.size:
            self._lib.receiver_window(self._handle, self._cells.ctypes.data)
        return self._cells

    def state(self) -> State:
        """As of the newest call; the next call overwrites it."""
        self._lib.receiver_state(self._handle, self._now_ms, ctypes.byref(self._state))
        return self._state

    def stale(self, now_s: float) -> bool:
        """Poses or maps do not come in time."""
        self._ms(now_s)
        return bool(self.state().stale)

    @property
    def suspect(self) -> bool:
        """Some cell may be outdated."""
        return bool(self.state().suspect)

    @property
    def blank(self) -> bool:
        """There is no map yet."""
        return bool(self.state().blank)

    def _ms(self, now_s: float) -> int:
        self._now_ms = math.floor(now_s * 1000 + 1e-6) % 2**32
        return self._now_ms
