"""What an MTi answers in Config state, by its model: settings, identity, and refusals.

Source: MTi sheet, sections 3, 5 and 9.
"""

import struct
from collections.abc import Callable

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
OUTPUTS = 0xC0


class Desk(Sensor):
    """A sensor that answers what needs no change of state."""

    def _answered(self, now_s: float, mid: int, data: bytes, in_config: bool) -> Answer:
        """The data of the answer, or the code of an Error."""
        memory = self.memory
        if mid in (NO_ROTATION, RESET_ORIENTATION):
            return self._timed(now_s, mid, data, in_config)
        if mid == OUTPUTS and not memory.model.legacy:
            return self._outputs(data)
        if mid in REGISTERS and (mid != SCENARIO or data):
            if not REGISTERS[mid].exists(memory):
                return NOT_IMPLEMENTED
            if not data:
                return REGISTERS[mid].read(memory)
            return REGISTERS[mid].write(memory, data) or b""
        told = self._without_data()
        if mid in told:
            return BAD_PARAMETER if data else told[mid]()
        return NOT_IMPLEMENTED

    def _without_data(self) -> dict[int, Callable[[], Answer]]:
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
        return told

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
