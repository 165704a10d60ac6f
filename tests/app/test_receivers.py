"""Several receivers of one app: each has its own link, and only one of them drives."""

from typing import Any

import numpy as np
import pytest

from app import App, Ports
from core.config import ConfigError
from core.records import FREE, OBSTACLE
from fakes.planner_mcu.receiver import FakePlanner
from fakes.wires.wire import MemoryPort
from mapod_link import serial_from_frame
from tests.support.robot.closed_loop import SESSION, ClosedLoop
from tests.support.robot.shipped import shipped
from wiring import open_ports

URLS = ["udp://127.0.0.1:9750", "serial:///dev/planner?baud=921600", "udp://127.0.0.1:9751"]
CODE = np.array([0, 2, 1], dtype=np.uint8)  # by cell value: unknown, obstacle (1), free (-1)


class Company(ClosedLoop):
    """Three receivers: the loop's own over UDP, one on a serial line, and one that only asks."""

    def __init__(self, *, drives: bool = True, **robot: Any) -> None:
        self._more = MemoryPort(), MemoryPort(datagrams=True)
        super().__init__(shipped(planner={"port": URLS}, robot=robot), drives=drives)
        self.planners = [self.planner, FakePlanner(seed=2), FakePlanner(seed=3, poll_only=True)]

    def _new_app(self, key: bytes | None) -> App:
        scanner, ahrs, drive = self.ports.values()
        return App(
            self.config, Ports(scanner, ahrs, drive, self.link_port, self._more), session=SESSION
        )

    def step(self) -> None:
        super().step()
        (serial, asked), (one, asker) = self._more, self.planners[1:]
        one.feed_stream(self.now_s, serial.take())
        for datagram in asked.take_datagrams():
            asker.feed_datagram(self.now_s, datagram)
        serial.give(b"".join(map(serial_from_frame, one.poll(self.now_s))))
        for answer in asker.poll(self.now_s):
            asked.give(answer)

    def meant(self) -> Any:
        """The map as the app has it, in the link's codes."""
        return CODE[self.map_now()]


@pytest.fixture(scope="module")
def company() -> Company:
    company = Company()
    company.planners[1].loss_rate = 0.02
    company.run(4.0)
    return company


def test_each_receiver_gets_the_map_whatever_the_others_lose(company: Company) -> None:
    company.planners[1].loss_rate = 0.0
    company.run(1.0)
    for planner in company.planners[:2]:
        assert not planner.suspect
        wrong = planner.window() != company.meant()
        assert int(wrong.sum()) <= 30  # of this very tick
    assert company.planners[1].numbers.missing > 0
    assert company.planners[0].numbers.missing == 0


def test_a_receiver_that_only_asks_gets_what_it_asks_for_and_nothing_else(company: Company) -> None:
    asker = company.planners[2]
    asker.accepted.clear()
    company.run(0.5)
    assert set(asker.accepted) <= {1}  # GEOM, for its HELLO
    size = company.app.config.obstacle.window_cells
    tiles = {
        layer: asker.ask_tile(layer, 0, 0, size, size, in_window=True)
        for layer in ("class", "height", "variance", "slope")
    }
    asker.ask(company.now_s, pose=True, stop_zone=True)
    company.run(1.5)
    assert all(tile.complete for tile in tiles.values())
    meant = company.meant()
    states = tiles["class"].values
    assert int((states != meant).sum()) <= 400  # the robot drives while pieces come
    floor = tiles["height"].values[meant == CODE[FREE]]
    assert abs(float(np.nanmedian(floor))) < 0.02
    assert float(np.nanmax(tiles["height"].values[meant == CODE[OBSTACLE]])) > 0.3
    assert asker.pose is not None
    assert asker.stop_zone is not None


@pytest.mark.parametrize(
    ("planner", "modbus", "said"),
    [
        ([*URLS[:1], "udp://nowhere"], "", r"planner\.port: 'udp://nowhere': must be udp://host"),
        (URLS[0], ["tcp://127.0.0.1:5020", "rtu:///dev/x"], r"modbus\.port: .*no such kind"),
        ("serial:///dev/x?baud=115200&bytesize=7", "", r"planner\.port: bytesize must be 8 here"),
        (URLS[0], "serial:///dev/x?baud=19200&bytesize=7", r"modbus\.port: bytesize must be 8"),
        (URLS[:1] * 2, "", r"planner\.port: each port may be given once"),
        ("serial:///dev/mti?baud=921600", "", r"planner\.port: .* is ahrs\.port already"),
        (
            "serial:///dev/plc?baud=19200",
            "serial:///dev/plc?baud=19200&parity=E",
            r"modbus\.port: .* is planner\.port already",
        ),
    ],
)
def test_ports_that_cannot_work_are_refused(
    planner: str | list[str], modbus: str | list[str], said: str
) -> None:
    with pytest.raises(ConfigError, match=said):
        open_ports(shipped(planner={"port": planner}, modbus={"port": modbus}))


def test_the_stop_zone_speaks_of_a_request_only_as_long_as_that_holds() -> None:
    company = Company(drives=False, enable_motors=True, start_clear_m=3.0)
    company.run(2.0)
    app, window = company.app, company.app.mapper.maps.window
    pose = app.mapper.maybe_pose(company.now_s)
    assert pose is not None
    i, j = window.grid.cell_of(pose.x_m - 0.5, pose.y_m)
    window.cells[j % window.grid.size, i % window.grid.size] = OBSTACLE  # behind it
    company.run(0.1)
    ahead = app.pilot.zone.state
    company.planners[0].drive(company.now_s, -0.2, 0.0, 0.3)
    company.run(0.2)
    assert app.pilot.zone.state == 3
    company.run(0.5)
    assert app.pilot.zone.state == ahead != 3
