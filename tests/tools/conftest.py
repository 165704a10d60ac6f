"""What tests of tools share."""

import pytest

from tests import Patch
from tests.support.devices.simulated_lines import SimulatedLines
from tools.cli import conversation


@pytest.fixture
def lines(monkeypatch: Patch) -> SimulatedLines:
    """The lines of this machine, on which tools find fakes instead of devices."""
    simulated = SimulatedLines()
    monkeypatch.setattr(conversation, "LINE", simulated)
    return simulated
