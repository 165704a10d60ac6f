"""The C header's receiver with all that its host library offers, for tests of the header."""

import ctypes
from collections import Counter
from ctypes import c_int16 as i16
from ctypes import c_int32 as i32
from ctypes import c_uint16 as u16
from ctypes import c_uint32 as u32
from typing import Any

from tools.conformance import c_receiver
from tools.conformance.c_receiver import MAX_OUT, c_struct

ADVICE = ("stop", "slow", "go")
WHY = (
    "", "a frame is missing", "no map yet", "link stale", "mode", "operator stop",
    "pose not valid", "map not valid", "attitude out of range", "drop-off ahead",
    "the map is not the sender's",
)  # fmt: skip
KINDS = {
    1: "geom", 2: "pose", 3: "map", 4: "digest", 5: "stop_zone", 6: "tile",
    16: "unknown_type", 17: "foreign_map", 18: "too_large",
}  # fmt: skip
REASONS = {1: "cobs", 2: "length", 3: "crc", 4: "version", 5: "flags", 6: "body", 7: "tag"}
NOT_KNOWN = -(2**31)  # of a tile's value
NO_YAW = -32_768


Ask, ExternalPose = c_struct("mapod_ask"), c_struct("mapod_external_pose")


def serial_from_frame(frame: bytes) -> bytes:
    """A frame as the header makes it ready for a serial line."""
    out = ctypes.create_string_buffer(frame, MAX_OUT)
    size = c_receiver.library().receiver_serial(out, len(frame))
    return out.raw[:size]


class CReceiver(c_receiver.CReceiver):
    """A receiver that says and shows all that it can; what it says is b"" where it refuses to."""

    def ack(self, now_s: float, hold_s: float | None = None) -> bytes:
        """`hold_s` is finer than the header's own milliseconds."""
        return self._built("ack", now_s, i32(-1 if hold_s is None else round(hold_s * 10_000)))

    def hello(self, now_s: float) -> bytes:
        return self._built("hello", now_s)

    def drive(self, now_s: float, v_mps: float, w_radps: float, valid_s: float) -> bytes:
        v, w, valid = round(v_mps * 1000), round(w_radps * 1000), round(valid_s * 1000)
        return self._built("drive", now_s, i16(v), i16(w), u16(valid))

    def external_pose(self, now_s: float, pose: ctypes.Structure) -> bytes:
        return self._built("external_pose", now_s, ctypes.byref(pose))

    def ask(self, now_s: float, ask: ctypes.Structure) -> bytes:
        return self._built("ask", now_s, ctypes.byref(ask))

    def _built(self, name: str, now_s: float, *arguments: Any) -> bytes:
        size = self._call(name, u32(self._ms(now_s)), *arguments, self._out)
        return self._out.raw[:size]

    def renew(self, nonce: int) -> None:
        """A new nonce in mid-life."""
        self._call("renew", u32(nonce))

    def cell_at(self, x_m: float, y_m: float) -> int:
        """The cell at a place of the map frame."""
        return self._call("at", i32(round(x_m * 1000)), i32(round(y_m * 1000))) & 0xFF

    def digest(self) -> int:
        """CRC-32 of the window, as the header computes it."""
        return self._call("digest") % 2**32

    def link_advice(self, now_s: float) -> tuple[str, str]:
        """("go" | "slow" | "stop", why)."""
        state = self.state(now_s)
        return ADVICE[state.advice], WHY[state.why]

    def zone_advice(self, now_s: float) -> str:
        """What the newest stop zone says."""
        return ADVICE[self.state(now_s).zone_advice]

    @property
    def origin(self) -> tuple[int, int] | None:
        """Lowest column and row in the endless grid, modulo 65 536 as int16; None while blank."""
        state = self.state()
        return None if state.blank else (state.ox, state.oy)

    @property
    def pose(self) -> Any:
        """`struct mapod_pose` of the newest, or None."""
        pose = self._shown("pose", c_struct("mapod_pose"))
        return pose.contents if pose else None

    @property
    def zone(self) -> Any:
        """`struct mapod_zone` of the newest."""
        return self._shown("zone", c_struct("mapod_zone")).contents

    @property
    def piece(self) -> Any:
        """`struct piece` of library.c: the newest of a tile."""
        newest = u32(self.state().newest_piece - 1)
        return self._shown("piece", c_struct("piece"), newest).contents

    @property
    def accepted(self) -> Counter[str]:
        """Frames accepted, by outcome."""
        counts = self._shown("accepted", u32)
        return Counter({name: counts[code] for code, name in KINDS.items() if counts[code]})

    @property
    def rejected(self) -> Counter[str]:
        """Frames rejected, by reason."""
        counts = self._shown("rejected", u32)
        return Counter({name: counts[code] for code, name in REASONS.items() if counts[code]})

    def _call(self, name: str, *arguments: Any) -> int:
        function = getattr(self._lib, f"receiver_{name}")
        return int(function(ctypes.c_void_p(self.handle), *arguments))

    def _shown(self, name: str, kind: type[Any], *arguments: Any) -> Any:
        """A pointer to what the library keeps."""
        function = getattr(self._lib, f"receiver_{name}")
        function.restype = ctypes.POINTER(kind)
        return function(ctypes.c_void_p(self.handle), *arguments)
