"""A client that others wrote, hokuyolx, and the fakes on real loopback TCP; simulated time."""

import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import numpy as np
import pytest

from fakes.urg04lx.device import FakeUrg04lx
from fakes.wires.timing import F64
from fakes.wires.wire import TcpWire
from fakes.world.simple import Room

hokuyolx = pytest.importorskip("hokuyolx")
refused = pytest.importorskip("hokuyolx.exceptions").HokuyoStatusException


@contextmanager
def client(model: str) -> Iterator[tuple[Any, FakeUrg04lx]]:
    """Connected; the fake's time runs as fast as it can be stepped, 1 ms a step."""
    fake, done = FakeUrg04lx(Room("room").ranges_m_at, 1, model), threading.Event()
    fake.baud, fake.noise = None, 0.0
    fake.exchange(100.0, b"SCIP2.0\n")
    with closing(TcpWire(fake)) as wire:

        def serve() -> None:
            steps = 0
            while not done.wait(0.0002):
                steps += 1
                wire.step(101.0 + steps * 0.001)

        server = threading.Thread(target=serve)
        server.start()
        try:
            laser = (
                hokuyolx.HokuyoLX(  # buf: it takes one message at a time only if it reads bytewise
                    *(False, False, False), addr=(wire.host, wire.port), buf=1, convert_time=False
                )
            )
            with closing(laser):
                yield laser, fake
        finally:
            done.set()
            server.join()


def room_mm(angles_rad: F64) -> F64:
    return 1000 * Room("room").ranges_m_at(0.0, angles_rad, angles_rad)


def test_it_goes_through_its_whole_session_with_the_ethernet_sister() -> None:
    with client("UTM-30LX") as (laser, _):
        laser.time_sync(N=3, dt=0)
        laser.update_info()
        assert (laser.amin, laser.amax, laser.aforw, laser.ares) == (0, 1080, 540, 1440)
        assert (laser.dmin, laser.dmax, laser.scan_freq) == (23, 60000, 40)
        assert laser.activate()[0] == 0
        assert laser.laser_state() == (3, "Single scan state")
        first_ms, ranges_mm = laser.get_dist()
        assert ranges_mm == pytest.approx(room_mm(laser.get_angles()), abs=1.0)
        scans = list(laser.iter_dist(scans=3, skips=1))
        assert [pending for _, _, pending in scans] == [2, 1, 0]
        times_ms = [time_ms for _, time_ms, _ in scans]
        assert first_ms < times_ms[0]
        assert np.diff(times_ms).tolist() == [50, 50]
        assert laser.laser_state() == (0, "Standby state")
        stream = laser.iter_dist(start=500, end=580)
        assert [len(next(stream)[0]) for _ in range(3)] == [81, 81, 81]
        laser.standby()
        laser.reset()
        assert laser.version()["PROT"] == "SCIP 2.0"
        assert laser.sensor_state()["LASR"] == "OFF"
        laser.activate()
        laser.reboot()
        assert laser.laser_state() == (0, "Standby state")


def test_it_measures_with_the_classic_model_whose_state_it_cannot_ask_for() -> None:
    with client("URG-04LX") as (laser, fake):
        with pytest.raises(refused):
            laser.laser_state()
        laser.update_info()
        assert (laser.amin, laser.amax, laser.aforw, laser.scan_freq) == (44, 725, 384, 10)
        assert laser.activate()[0] == 0
        assert laser.activate()[0] == 2
        _, ranges_mm = laser.get_dist()
        angles_rad = 2 * np.pi / 1024 * (np.arange(44.0, 726.0) - 384)
        assert ranges_mm == pytest.approx(room_mm(angles_rad), abs=1.0)
        assert len(list(laser.iter_dist(scans=2, grouping=2))) == 2
        fake.trouble = 60
        laser.reset()
        with pytest.raises(refused):
            laser.get_dist()
