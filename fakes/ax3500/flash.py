"""The parameters of the fake AX3500: what its flash holds, and which values it takes.

Source: AX3500 sheet, section 7.
"""

from fakes.ax3500.power import Model, PowerStage

STATUS, IDENTITY, LIMIT_ONE, LIMIT_TWO = 0x89, 0x8A, 0x8B, 0x8C
FACTORY = {  # parameter -> value
    **dict.fromkeys((0x01, 0x02, 0x07, 0x08, 0x0B), 0x00),
    0x03: 0x20,
    0x04: 0x01,
    **dict.fromkeys((0x0C, 0x0F, 0x10, 0x11), 0x10),
    0x80: 0x01,
    0x81: 0x01,
    0x88: 0x10,
    **dict.fromkeys(range(0x82, 0x88), 0x10),
}
HIGHEST = {0x00: 3, 0x01: 0xC6, 0x07: 4, 0x08: 4, **dict.fromkeys((0x0C, 0x0F, 0x10, 0x11), 63)}


class Parameters(PowerStage):
    """What `^nn` reads and writes; a write is permanent at once and takes effect later."""

    def __init__(self, mode: int, model: Model) -> None:
        super().__init__(model)
        self.parameters = {0x00: mode, **FACTORY}  # flash
        self.never_written: set[int] = set()  # parameters that cannot be read until written
        self.flash_writes = 0

    def maybe_parameter(self, address: int) -> int | None:
        """The byte at an address; None: not one that can be read."""
        if address in self.never_written:
            return None
        limit = self.limit_byte()
        now = {LIMIT_ONE: limit, LIMIT_TWO: limit, STATUS: self.condition()}
        now[IDENTITY] = self.identity
        return now.get(address, self.parameters.get(address))

    def set_parameter(self, address: int, value: int) -> bool:
        """Write one byte; False: no such parameter, or a value that it does not take."""
        if address not in self.parameters or value > HIGHEST.get(address, 0xFF):
            return False
        if address == 0x01 and (value & 0x38 or value & 0x07 == 7):
            return False
        self.parameters[address] = value
        self.never_written.discard(address)
        self.flash_writes += address < 0x80
        return True
