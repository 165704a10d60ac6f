"""A wire that goes and comes back: the receiver lives on, and what was known counts no more."""

import asyncio
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from mapod_link.frames import GEOM, MAP, POSE, bytes_from_frame
from mapod_link.serial_line import serial_from_frame
from mapod_link.wires import wire_from_url
from tests.support.link.planner_sender import geom_body, map_body, pose_body
from tools.view.link_end import LinkEnd

PATIENCE_S = 60.0


class Line:
    """The robot's end of a serial line, plugged in under one name."""

    def __init__(self, path: Path, session: int) -> None:
        self._fd, self._slave = os.openpty()
        path.unlink(missing_ok=True)
        path.symlink_to(os.ttyname(self._slave))
        self._session = session

    def tell(self) -> None:
        told = (GEOM, geom_body(session=self._session)), (POSE, pose_body()), (MAP, map_body())
        for seq, (kind, body) in enumerate(told):
            os.write(self._fd, serial_from_frame(bytes_from_frame(kind, seq, 1000, body)))

    def unplug(self) -> None:
        os.close(self._slave)
        os.close(self._fd)


async def until(holds: Callable[[], object]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not holds():
            await asyncio.sleep(0.01)


@pytest.mark.real_time
def test_a_line_that_is_pulled_out_is_said_and_opened_again(tmp_path: Path) -> None:
    async def run() -> None:
        line = Line(tmp_path / "line", session=1)
        end = LinkEnd(wire_from_url(f"serial://{tmp_path / 'line'}?baud=115200"))
        listening = asyncio.create_task(end.run(lambda now_s: None))
        line.tell()
        await until(lambda: not end.receiver.blank)
        assert (end.epoch, end.trouble) == (1, "")
        line.unplug()
        await until(lambda: end.trouble)
        assert end.trouble.startswith("the wire is gone: ")
        end.step()  # nothing to step: no harm
        line = Line(tmp_path / "line", session=2)
        await until(lambda: not end.trouble)
        line.tell()
        await until(lambda: end.epoch == 2)
        listening.cancel()
        end.close()
        line.unplug()

    asyncio.run(run())
