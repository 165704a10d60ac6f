"""What an MTi answers in Config state, by its model: settings, identity, and refusals.

Source: MTi sheet, sections 3, 5 and 9.
"""

import struct
from collections.abc import Callable

from fakes.mti.gnss import NO_TIME, RESOLVED, utc
from fakes.mti.memory import (
    BAD_PARAMETER,
    NOT_IMPLEMENTED,
    REGISTERS,
    Memory,
    bauds,
    scenarios,
)
from fakes.mti.models import FIFTH
from fakes.mti.outputs import check_fits, maybe_outputs, speaks_legacy, wire_form
from fakes.mti.sensor import Sensor

Answer = bytes | int  # the data, or the code of an Error
SCENARIO, SELF_TEST, NO_ROTATION, RESET_ORIENTATION = 0x64, 0x24, 0x22, 0xA4
PROCESSING, SYNC, POSITION, OUTPUTS, TURN = 0x20, 0x2C, 0x6E, 0xC0, 0xEC
SYNC_BYTES, MOST_SYNCS = 12, 10
LEGACY_POSITION_BYTES, POSITION_BYTES = (12, 18), (24,)


class Desk(Sensor):
    """A sensor that answers what needs no change of state."""

    def _answered(self, now_s: float, mid: int, data: bytes, in_config: bool) -> Answer:
        """The data of the answer, or the code of an Error."""
        memory, special = self.memory, self._special()
        if mid in (NO_ROTATION, RESET_ORIENTATION):
            return self._timed(now_s, mid, data, in_config)
        if mid in special:
            return special[mid](data)
        if mid in REGISTERS and (mid != SCENARIO or data):
            if not REGISTERS[mid].exists(memory):
                return NOT_IMPLEMENTED
            if not data:
                return REGISTERS[mid].read(memory)
            return REGISTERS[mid].write(memory, data) or b""
        told = self._without_data(now_s)
        if mid in told:
            return BAD_PARAMETER if data else told[mid]()
        return NOT_IMPLEMENTED

    def _without_data(self, now_s: float) -> dict[int, Callable[[], Answer]]:
        """What is asked for by an empty message."""
        memory = self.memory
        model = memory.model
        told: dict[int, Callable[[], Answer]] = {
            0x00: lambda: model.device_id,
            0x02: lambda: model.device_id,
            0x0C: memory.configuration,
            0x0E: self._restore,
            0x12: lambda: model.firmware,
            0x1C: lambda: model.product,
            SELF_TEST: lambda: struct.pack(">H", self.self_test),
            0x62: lambda: scenarios(model),
            SCENARIO: lambda: bytes([memory.scenario_version, memory.scenario]),
        }
        if not memory.mtdata2:
            told[0x0A] = lambda: struct.pack(">H", memory.length())
        if not model.legacy:
            told[0x1E] = lambda: model.hardware
        if model.gnss or not model.legacy:
            valid = 1 if model.legacy else RESOLVED
            fix = model.gnss and self.gps_fix
            told[0x60] = lambda: utc(self.utc_at_zero_s + now_s, valid if fix else NO_TIME)
        return told

    def _special(self) -> dict[int, Callable[[bytes], Answer]]:
        """What has a form of its own."""
        model = self.memory.model
        special: dict[int, Callable[[bytes], Answer]] = {PROCESSING: self._processing}
        if not model.legacy:
            special |= {SYNC: self._sync, OUTPUTS: self._outputs, TURN: self._turn}
        if model.gnss or not model.legacy:
            special[POSITION] = self._lat_lon_alt
        return special

    def _restore(self) -> bytes:
        self.memory = Memory(self.memory.model)
        self._forget_resets()
        return b""

    def _timed(self, now_s: float, mid: int, data: bytes, in_config: bool) -> Answer:
        """No-rotation update and orientation reset."""
        if len(data) != 2:
            return BAD_PARAMETER
        (value,) = struct.unpack(">H", data)
        if mid == RESET_ORIENTATION:
            return self._reset_orientation(now_s, value, in_config)
        self._still_until_s = now_s + value
        return b""

    def _processing(self, data: bytes) -> Answer:
        """Two bytes to some hosts, one to others: both are taken."""
        if not data:
            return self.memory.processing.to_bytes(2 if self.memory.model.legacy else 1, "big")
        if len(data) > 2:
            return BAD_PARAMETER
        self.memory.processing = int.from_bytes(data, "big")
        self.memory.processing &= 0xFFFF if self.memory.model.legacy else 0xFF
        return b""

    def _sync(self, data: bytes) -> Answer:
        if not data:
            return self.memory.sync
        if len(data) % SYNC_BYTES or len(data) > SYNC_BYTES * MOST_SYNCS:
            return BAD_PARAMETER
        self.memory.sync = data
        return b""

    def _lat_lon_alt(self, data: bytes) -> Answer:
        sizes = LEGACY_POSITION_BYTES if self.memory.model.legacy else POSITION_BYTES
        if not data:
            return self.memory.lat_lon_alt or bytes(sizes[-1])
        if len(data) not in sizes:
            return BAD_PARAMETER
        self.memory.lat_lon_alt = data
        return b""

    def _turn(self, data: bytes) -> Answer:
        """Alignment rotation: 0 of the sensor, 1 of the earth frame; one byte alone reads it."""
        if len(data) not in (1, 17) or data[0] > 1:
            return BAD_PARAMETER
        if len(data) == 1:
            return data + struct.pack(">4f", *self.memory.turns[data[0]])
        quaternion = struct.unpack(">4f", data[1:])
        if not abs(sum(part * part for part in quaternion) - 1.0) < 1e-3:
            return BAD_PARAMETER
        self.memory.turns[data[0]] = quaternion
        return b""

    def _outputs(self, data: bytes) -> Answer:
        """The output configuration, read or set; the values taken come back."""
        memory = self.memory
        if speaks_legacy(data, memory.model):
            memory.mtdata2 = False
            return data
        taken = maybe_outputs(data, memory.model) if data else memory.outputs
        if isinstance(taken, int):
            return taken
        code = self._check_fits(taken)
        if code:
            return code
        if data:
            memory.outputs, memory.mtdata2 = taken, True
        return wire_form(taken) if memory.mtdata2 else bytes(4)

    def _check_fits(self, outputs: tuple[tuple[int, int], ...]) -> int:
        """0, or the Error of a list that the line cannot carry at the rate that is stored."""
        model = self.memory.model
        return check_fits(outputs, model, bauds(model)[self.memory.baud_code])

    def _is_silent(self, mid: int) -> bool:
        """Whether the device gives no answer at all."""
        model = self.memory.model
        return model.generation == FIFTH and mid in model.silent_mids
