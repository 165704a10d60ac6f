"""The fake's frames against the one of the sheet, byte for byte."""

import numpy as np

from fakes.visionary.faults import Faults
from fakes.visionary.frames import binary, message, stamp_of
from fakes.visionary.models import KINDS
from fakes.visionary.picture import Maps
from tests.support.devices.visionary_vectors import T_MINI

RAW = [4000, 4001, 0, 65535, 4096, 4096, 4096, 4096, 16384, 2000, 8000, 1]
GREY = [1, 2, 3, 4, 100, 200, 300, 400, 20000, 0, 65535, 7]
STATES = [0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 4]
XML_AT, BINARY_AT = 39, 39 + 1371


def test_the_frame_of_the_sheet_is_what_it_would_send() -> None:
    raw, grey, states = (np.array(one, np.uint16).reshape(3, 4) for one in (RAW, GREY, STATES))
    maps = Maps(raw, grey, states, np.zeros((3, 4)))
    depths = binary(maps, KINDS["t_mini"], Faults("t_mini"), 1795358159.123, 42)
    assert depths == T_MINI[BINARY_AT : BINARY_AT + 100]
    assert message(T_MINI[XML_AT:BINARY_AT], 1, depths, 3) == T_MINI


def test_its_times_are_those_of_the_sheet() -> None:
    assert stamp_of(1795358159.123) == 0x03F55D8003A3EC7B
