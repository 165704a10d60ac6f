"""The C header of the planner link as a Python object, for tests: the same calls as the receiver's.

Built once by gcc, see `tools.rig.c_build`; where a program is missing, the test is skipped.
"""

import ctypes
import functools
import math
from collections import Counter
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from tests.support.c_types import KINDS, REASONS, Ask, ExternalPose, Piece, Pose, State, Zone
from tools.rig import c_build
from tools.rig.c_build import BUILD, MCU, STRICT, MissingToolError

__all__ = ["BUILD", "MCU", "STRICT", "CReceiver", "built", "compile_c", "needs"]

U8 = npt.NDArray[np.uint8]
OUT_BYTES = 64
ADVICE = ("stop", "slow", "go")
WHY = (
    "", "a frame is missing", "no map yet", "link stale", "mode", "operator stop",
    "pose not valid", "map not valid", "attitude out of range", "drop-off ahead",
    "the map is not the sender's",
)  # fmt: skip


def needs(program: str, package: str = "") -> str:
    """The program's path; skips the test where it is missing."""
    try:
        return c_build.program(program, package)
    except MissingToolError as missing:
        is_board = program.startswith(("arm-", "qemu-"))
        pytest.skip(f"{missing}{'; its host form is tested instead' * is_board}")


def compile_c(compiler: str, package: str, output: Path, *arguments: str) -> Path:
    """Runs a compiler; the test fails with its words if it is not content."""
    needs(compiler, package)
    return c_build.compile_c(compiler, output, *arguments, package=package)


def built(
    name: str, source: str, *arguments: str, compiler: str = "gcc", package: str = ""
) -> Path:
    """A program or library of a file in hw/mcu; compiled anew where sources or words changed."""
    needs(compiler, package)
    return c_build.built(name, source, *arguments, compiler=compiler, package=package)


def build_library(*arguments: str, compiler: str = "gcc") -> Path:
    """The header as a shared library, see hw/mcu/host/library.c."""
    words = ("-O2", "-shared", "-fPIC", *arguments)
    return built("link.so", "host/library.c", *words, compiler=compiler)


def build_receiver() -> Path:
    """The header as a program, see hw/mcu/host/receiver.c."""
    return built("receiver", "host/receiver.c", "-O2")


@functools.cache
def library(*settings: str) -> ctypes.CDLL:
    """The header, compiled for this machine, with its calls' types."""
    lib = ctypes.CDLL(str(build_library(*settings)))
    handle, u32, u8s = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_char_p
    lib.receiver_new.argtypes = [u32, u32, u8s, ctypes.c_int]
    lib.receiver_new.restype = handle
    lib.receiver_free.argtypes = [handle]
    lib.receiver_datagram.argtypes = [handle, u32, u8s, u32]
    lib.receiver_stream.argtypes = [handle, u32, u8s, u32, ctypes.POINTER(ctypes.c_int)]
    lib.receiver_window.argtypes = [handle, ctypes.c_void_p]
    lib.receiver_ack.argtypes = [handle, u32, ctypes.c_int32, u8s]
    drive = [ctypes.c_int16, ctypes.c_int16, ctypes.c_uint16]
    lib.receiver_drive.argtypes = [handle, u32, *drive, u8s]
    lib.receiver_external_pose.argtypes = [handle, u32, ctypes.POINTER(ExternalPose), u8s]
    lib.receiver_ask.argtypes = [handle, u32, ctypes.POINTER(Ask), u8s]
    lib.receiver_serial.argtypes = [u8s, u32]
    lib.receiver_say.argtypes = [handle, ctypes.c_int, ctypes.c_int]
    lib.receiver_state.argtypes = [handle, u32, ctypes.POINTER(State)]
    lib.receiver_cell.argtypes = [handle, u32, u32]
    lib.receiver_cell.restype = ctypes.c_uint8
    lib.receiver_at.argtypes = [handle, ctypes.c_int32, ctypes.c_int32]
    lib.receiver_at.restype = ctypes.c_uint8
    lib.receiver_piece.argtypes = [handle, u32]
    lib.receiver_piece.restype = ctypes.POINTER(Piece)
    lib.receiver_pose.argtypes = [handle]
    lib.receiver_pose.restype = ctypes.POINTER(Pose)
    lib.receiver_zone.argtypes = [handle]
    lib.receiver_zone.restype = ctypes.POINTER(Zone)
    for name in ("receiver_poll", "receiver_hello"):
        getattr(lib, name).argtypes = [handle, u32, u8s]
    lib.receiver_renew.argtypes = [handle, u32]
    lib.receiver_digest.argtypes = [handle]
    for name in ("receiver_accepted", "receiver_rejected"):
        getattr(lib, name).argtypes = [handle]
        getattr(lib, name).restype = ctypes.POINTER(u32)
    for name in ("stream", "ack", "drive", "external_pose", "ask", "serial", "poll", "hello"):
        getattr(lib, f"receiver_{name}").restype = u32
    lib.receiver_digest.restype = u32
    return lib


def serial_from_frame(frame: bytes) -> bytes:
    """A frame as the header makes it ready for a serial line."""
    out = ctypes.create_string_buffer(frame, OUT_BYTES)
    size = library().receiver_serial(out, len(frame))
    return out.raw[:size]


class CReceiver:
    """A receiver of the C header. Times are seconds; the header counts whole milliseconds.

    Args:
        nonce: of its HELLO; 0 where there is no return path.
        key: 32 bytes, or None.
        ack_every: accepted frames per ACK; 0 sends nothing at all.
        ack_period_s: an ACK at least so often; the header's own 0.1 s always holds too.
        max_cells: of the largest window that it takes.
        poll_only: the sender shall push nothing.
        settings: words for the compiler that set the header up.
    """

    def __init__(
        self,
        nonce: int = 1,
        *,
        key: bytes | None = None,
        ack_every: int = 16,
        ack_period_s: float = 0.1,
        max_cells: int = 401 * 401,
        poll_only: bool = False,
        settings: tuple[str, ...] = (),
    ) -> None:
        self._lib = library(*settings)
        self.nonce, self.max_cells = nonce if ack_every else 0, max_cells
        self.ack_every, self.ack_period_s = ack_every, ack_period_s
        self._unacked, self._acked_s = 0, -math.inf
        self._outbox: list[bytes] = []
        self._poll_only = poll_only
        self._now_s = 0.0
        self.handle = self._lib.receiver_new(max_cells, self.nonce, key, int(poll_only))
        assert self.handle

    def __del__(self) -> None:
        if getattr(self, "handle", None):
            self._lib.receiver_free(self.handle)

    # Bytes in

    def feed_datagram(self, now_s: float, data: bytes) -> bool:
        """One frame; whether it was accepted."""
        outcome = self._lib.receiver_datagram(self.handle, self._ms(now_s), data, len(data))
        self._note(now_s, outcome)
        return bool(outcome > 0)

    def feed_stream(self, now_s: float, data: bytes) -> None:
        """Bytes of a serial line, cut anywhere."""
        at, outcome = 0, ctypes.c_int()
        while at < len(data):
            rest = data[at:]
            at += self._lib.receiver_stream(
                self.handle, self._ms(now_s), rest, len(rest), ctypes.byref(outcome)
            )
            self._note(now_s, outcome.value)

    def _note(self, now_s: float, outcome: int) -> None:
        self._unacked += outcome > 0
        if self._unacked >= self.ack_every > 0 and not self._poll_only:
            self.acknowledge(now_s)

    # Bytes out

    def poll(self, now_s: float) -> list[bytes]:
        """Frames to send, not framed for a serial line."""
        if self.ack_every:
            self._queue(self._lib.receiver_poll, now_s)
            any_yet = self.state(now_s).any and not self._poll_only
            if any_yet and now_s - self._acked_s >= self.ack_period_s:
                self.acknowledge(now_s)
        return self.take()

    def take(self) -> list[bytes]:
        """What has been queued, and nothing besides."""
        frames, self._outbox = self._outbox, []
        return frames

    def exchange(self, now_s: float, received: bytes) -> bytes:
        """The receiver on a serial line: what came, and what it sends."""
        self.feed_stream(now_s, received)
        return b"".join(serial_from_frame(frame) for frame in self.poll(now_s))

    def acknowledge(self, now_s: float, hold_s: float | None = None) -> None:
        """Queue an ACK; `hold_s` is finer than the header's own milliseconds."""
        self._unacked, self._acked_s = 0, now_s
        hold = -1 if hold_s is None else round(hold_s * 10_000)
        self._queue(self._lib.receiver_ack, now_s, hold)

    def hello(self, now_s: float) -> None:
        """Queue a HELLO."""
        self._queue(self._lib.receiver_hello, now_s)

    def renew(self, nonce: int) -> None:
        """A new nonce in mid-life."""
        self._lib.receiver_renew(self.handle, nonce)

    def drive(self, now_s: float, v_mps: float, w_radps: float, valid_s: float) -> bool:
        """Queue a DRIVE; False: the header refuses to build it."""
        numbers = round(v_mps * 1000), round(w_radps * 1000), round(valid_s * 1000)
        return self._queue(self._lib.receiver_drive, now_s, *numbers)

    def external_pose(self, now_s: float, pose: ExternalPose) -> bool:
        """Queue an EXTERNAL_POSE."""
        return self._queue(self._lib.receiver_external_pose, now_s, ctypes.byref(pose))

    def ask(self, now_s: float, ask: Ask) -> bool:
        """Queue an ASK."""
        return self._queue(self._lib.receiver_ask, now_s, ctypes.byref(ask))

    def _queue(self, build: object, now_s: float, *arguments: object) -> bool:
        assert callable(build)
        out = ctypes.create_string_buffer(OUT_BYTES)
        size = build(self.handle, self._ms(now_s), *arguments, out)
        if size:
            self._outbox.append(out.raw[:size])
        return bool(size)

    def say(self, what: str, on: bool = True) -> None:
        """What its next ACKs say: "stopped", "need_full", "need_geom" or "suspect"."""
        which = ("stopped", "need_full", "need_geom", "suspect").index(what)
        self._lib.receiver_say(self.handle, which, int(on))

    # What it knows

    def state(self, now_s: float) -> State:
        """Everything small, as of now."""
        state = State()
        self._lib.receiver_state(self.handle, self._ms(now_s), ctypes.byref(state))
        return state

    def window(self) -> U8:
        """(height, width) copy of all cells; (0, 0) without a geometry."""
        state = self.state(self._now_s)
        shape = (state.height, state.width) if state.has_geom else (0, 0)
        cells: U8 = np.empty(shape, np.uint8)
        if cells.size:
            self._lib.receiver_window(self.handle, cells.ctypes.data)
        return cells

    def cell(self, col: int, row: int) -> int:
        """Of the window; what lies outside is unknown."""
        inside = col >= 0 and row >= 0
        return self._lib.receiver_cell(self.handle, col, row) if inside else 0

    def cell_at(self, x_m: float, y_m: float) -> int:
        """The cell at a place of the map frame."""
        x_mm, y_mm = round(x_m * 1000), round(y_m * 1000)
        return int(self._lib.receiver_at(self.handle, x_mm, y_mm))

    def digest(self) -> int:
        """CRC-32 of the window, as the header computes it."""
        return int(self._lib.receiver_digest(self.handle))

    def stale(self, now_s: float) -> bool:
        """Poses or maps do not arrive in time."""
        return bool(self.state(now_s).stale)

    def link_advice(self, now_s: float) -> tuple[str, str]:
        """("go" | "slow" | "stop", why)."""
        state = self.state(now_s)
        return ADVICE[state.advice], WHY[state.why]

    def zone_advice(self, now_s: float) -> str:
        """What the newest stop zone says."""
        return ADVICE[self.state(now_s).zone_advice]

    @property
    def suspect(self) -> bool:
        """Some cell may be outdated."""
        return bool(self.state(self._now_s).suspect)

    @property
    def blank(self) -> bool:
        """There is no map yet."""
        return bool(self.state(self._now_s).blank)

    @property
    def origin(self) -> tuple[int, int] | None:
        """Lowest column and row in the endless grid, modulo 65 536 as int16; None while blank."""
        state = self.state(self._now_s)
        return None if state.blank else (state.ox, state.oy)

    @property
    def pose(self) -> Pose | None:
        """Newest pose, in the frame's units."""
        pose = self._lib.receiver_pose(self.handle)
        return pose.contents if pose else None

    @property
    def zone(self) -> Zone:
        """Newest stop zone, in the frame's units."""
        zone: Zone = self._lib.receiver_zone(self.handle).contents
        return zone

    @property
    def pieces(self) -> list[Piece]:
        """Pieces of tiles, the newest 256 at most, oldest first."""
        newest = self.state(self._now_s).newest_piece
        numbers = range(max(0, newest - 256), newest)
        return [self._lib.receiver_piece(self.handle, k).contents for k in numbers]

    @property
    def accepted(self) -> Counter[str]:
        """Frames accepted, by outcome."""
        counts = self._lib.receiver_accepted(self.handle)
        return Counter({name: counts[code] for code, name in KINDS.items() if counts[code]})

    @property
    def rejected(self) -> Counter[str]:
        """Frames rejected, by reason."""
        counts = self._lib.receiver_rejected(self.handle)
        return Counter({name: counts[code] for code, name in REASONS.items() if counts[code]})

    def _ms(self, now_s: float) -> int:
        self._now_s = now_s
        return math.floor(now_s * 1000 + 1e-6) % 2**32
