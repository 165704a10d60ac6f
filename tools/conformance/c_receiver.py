"""The C header as a receiver in process: hw/mcu/host/library.c, built by the host's compiler."""

import ctypes
import functools
import math
import re
from ctypes import c_uint32 as u32

import numpy as np

from tools.conformance.wire import U8
from tools.rig.planner.build import MCU, built

MAX_OUT = 64  # bytes of the longest answer
LIBRARY = MCU / "host" / "library.c"


@functools.cache
def c_struct(name: str) -> type[ctypes.Structure]:
    """`struct name` of the header or of library.c, with the members that it has there."""
    text = (MCU / "mapod_link.h").read_text() + LIBRARY.read_text()
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    found = re.search(rf"struct {name} {{(.*?)}};", text, re.DOTALL)
    assert found is not None, name
    members: list[tuple[str, type]] = []
    for kind, several in re.findall(r"(u?int\d+)_t ([^;]+);", found[1]):
        for member, count in re.findall(r"(\w+)(?:\[(\d+)\])?", several):
            one = getattr(ctypes, f"c_{kind}")
            members.append((member, one * int(count) if count else one))
    return type(name, (ctypes.Structure,), {"_fields_": members})


@functools.cache
def library(*settings: str) -> ctypes.CDLL:
    """The header as a shared library, set up by words for the compiler.

    Raises:
        MissingToolError, CompileError: see `tools.rig.planner.build`.
    """
    words = ("-O2", "-shared", "-fPIC", *settings)
    lib = ctypes.CDLL(str(built("link.so", LIBRARY, *words)))
    handle, data = ctypes.c_void_p, ctypes.c_char_p
    lib.receiver_new.argtypes = [u32, u32, data, ctypes.c_int, ctypes.c_int]
    lib.receiver_new.restype = handle
    lib.receiver_free.argtypes = [handle]
    lib.receiver_datagram.argtypes = [handle, u32, data, u32]
    lib.receiver_stream.argtypes = [handle, u32, data, u32, ctypes.POINTER(ctypes.c_int)]
    lib.receiver_stream.restype = u32
    lib.receiver_window.argtypes = [handle, ctypes.c_void_p]
    lib.receiver_poll.argtypes, lib.receiver_poll.restype = [handle, u32, data], u32
    lib.receiver_say.argtypes = [handle, ctypes.c_int, ctypes.c_int]
    lib.receiver_state.argtypes = [handle, u32, ctypes.c_void_p]
    return lib


class CReceiver:
    """A receiver of the C header. Times are seconds; the header counts whole milliseconds.

    Args:
        nonce: of its HELLO; 0 where there is no return path.
        key: 32 bytes, or None.
        max_cells: of the largest window that it takes.
        poll_only: the sender shall push nothing.
        keeps_map: False: it has no memory for a map.
        settings: words for the compiler that set the header up.
    """

    def __init__(
        self,
        nonce: int,
        *,
        key: bytes | None = None,
        max_cells: int = 401 * 401,
        poll_only: bool = False,
        keeps_map: bool = True,
        settings: tuple[str, ...] = (),
    ) -> None:
        self._lib = library(*settings)
        self.nonce = nonce
        self.handle = self._lib.receiver_new(max_cells, nonce, key, poll_only, keeps_map)
        self._state, self._out = c_struct("state")(), ctypes.create_string_buffer(MAX_OUT)
        self._now_ms = 0

    def __del__(self) -> None:
        if getattr(self, "handle", None):
            self._lib.receiver_free(self.handle)

    def feed_datagram(self, now_s: float, data: bytes) -> bool:
        """One frame; whether it was accepted."""
        outcome: int = self._lib.receiver_datagram(self.handle, self._ms(now_s), data, len(data))
        return outcome > 0

    def feed_stream(self, now_s: float, data: bytes) -> None:
        """Bytes of a serial line, cut anywhere."""
        outcome, now_ms = ctypes.c_int(), self._ms(now_s)
        while data:
            used = self._lib.receiver_stream(
                self.handle, now_ms, data, len(data), ctypes.byref(outcome)
            )
            data = data[used:]

    def poll(self, now_s: float) -> list[bytes]:
        """Frames to send; the header decides when."""
        frames, now_ms = [], self._ms(now_s)
        while size := self._lib.receiver_poll(self.handle, now_ms, self._out):
            frames.append(self._out.raw[:size])
        return frames

    def say(self, what: str, on: bool = True) -> None:
        """What its next ACKs say: "stopped", "need_full", "need_geom" or "suspect"."""
        which = ("stopped", "need_full", "need_geom", "suspect").index(what)
        self._lib.receiver_say(self.handle, which, on)

    def window(self) -> U8:
        """(height, width) of all cells; (0, 0) without a geometry."""
        state = self.state()
        cells: U8 = np.zeros((state.height, state.width) if state.has_geom else (0, 0), np.uint8)
        if cells.size:
            self._lib.receiver_window(self.handle, cells.ctypes.data)
        return cells

    def state(self, now_s: float | None = None) -> ctypes.Structure:
        """`struct state`, as of now or of the newest call; the next call overwrites it."""
        now_ms = self._now_ms if now_s is None else self._ms(now_s)
        self._lib.receiver_state(self.handle, now_ms, ctypes.byref(self._state))
        return self._state

    def stale(self, now_s: float) -> bool:
        """Poses or maps do not come in time."""
        return bool(self.state(now_s).stale)

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
