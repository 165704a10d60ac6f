"""A fake URG-04LX that streams full scans for a host that has gone, at 19200 baud."""

import numpy as np

from fakes.urg04lx.device import FakeUrg04lx
from tests.support.devices.simulated_lines import START_S, SimulatedLines


def streams_at_19200(lines: SimulatedLines) -> FakeUrg04lx:
    """In the midst of its first scan."""
    fake = FakeUrg04lx(lambda t_s, times_s, bearings_rad: np.full(len(times_s), 2.0), 1)
    path = lines.serial(fake)
    fake.leave_streaming(START_S)
    lines.run(path, lambda: lines.clocks.get(path, START_S) > START_S + 0.5)
    return fake
