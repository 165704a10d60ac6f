"""The register image read by others' clients: pymodbus's own and libmodbus (C)."""

import asyncio
import contextlib
import shutil
import subprocess
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest
from pymodbus.client import AsyncModbusUdpClient
from pymodbus.pdu.mei_message import ReadDeviceInformationResponse

from hw.modbus.image import RegisterImage
from hw.modbus.layout import COARSE, WINDOW, stride_of
from tests.support.machine import modbus_rig as rig
from tools.rig.planner.build import MissingToolError

COUNT = 10 + rig.SIZE * stride_of(rig.SIZE) + 1  # registers of a window: head, cells, generation
SOURCE = Path(__file__).parent / "modbus_reader.c"


@contextlib.asynccontextmanager
async def offered(kind: str) -> AsyncIterator[tuple[RegisterImage, int, str]]:
    """An image, and the port or the end of the line at which a client finds it."""
    image, port, line, end = rig.new_image(), rig.free_port(), rig.Line(), rig.Line()
    url = f"serial://{line.path}?baud=115200" if kind == "rtu" else f"{kind}://127.0.0.1:{port}"
    async with rig.serving(url, image, rig.Clock()):
        join(line, end)  # two ptys: each client opens a line itself
        yield image, port, end.path
        for one in (line, end):
            asyncio.get_running_loop().remove_reader(one.master)
    line.close()
    end.close()


@rig.in_loop
async def test_pymodbus_reads_the_image() -> None:
    """Over UDP, which libmodbus does not speak; all that it can be asked to do."""
    async with offered("udp") as (image, port, _):
        client = AsyncModbusUdpClient("127.0.0.1", port=port)
        assert await client.connect()
        for first, count in ((0, 80), (WINDOW, 100)):
            read = await client.read_holding_registers(first, count=count, device_id=2)
            assert list(read.registers) == rig.words(image, first, count)
        wrong = await client.read_holding_registers(60000, count=1, device_id=1)
        assert (wrong.isError(), wrong.exception_code) == (True, 2)
        assert not (await client.write_register(90, 0, device_id=2)).isError()
        bits = await client.read_coils(0, count=16, device_id=1)
        assert [k for k, bit in enumerate(bits.bits) if bit] == [4, 6, 8, 10, 11, 14]
        names = await client.read_device_information(read_code=2, device_id=1)
        assert isinstance(names, ReadDeviceInformationResponse)
        assert names.information[0] == b"mapod"
        client.close()


def join(one: rig.Line, other: rig.Line) -> None:
    """What comes out of either pty goes into the other."""
    loop = asyncio.get_running_loop()

    def carry(source: rig.Line, to: rig.Line) -> Callable[[], None]:
        def move() -> None:
            source.listen()
            to.send(bytes(source.heard))
            source.heard.clear()

        return move

    loop.add_reader(one.master, carry(one, other))
    loop.add_reader(other.master, carry(other, one))


async def output_of(*command: str) -> str:
    """What a program prints while the server goes on in this loop."""
    process = await asyncio.create_subprocess_exec(
        *command, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
    )
    out, err = await asyncio.wait_for(process.communicate(), 120)
    assert process.returncode == 0, err.decode() + out.decode()
    return out.decode()


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> str:
    if shutil.which("gcc") is None:
        raise MissingToolError("needs gcc: apt install gcc")
    if not any(Path("/usr").glob("include/modbus/modbus.h")):
        raise MissingToolError("needs libmodbus: apt install libmodbus-dev")
    program = tmp_path_factory.mktemp("reader") / "reader"
    command = ["gcc", "-std=gnu99", "-Wall", "-Wextra", "-Werror", "-I/usr/include/modbus"]
    subprocess.run([*command, str(SOURCE), "-o", str(program), "-lmodbus"], check=True)
    return str(program)


@pytest.mark.parametrize("kind", ["tcp", "rtu"])
@rig.in_loop
async def test_libmodbus_reads_the_image(kind: str, reader: str) -> None:
    async with offered(kind) as (image, port, path):
        where = ["rtu", path, "115200"] if kind == "rtu" else ["tcp", str(port)]
        out = await output_of(reader, *where, "2")
    status, coarse, window = ([int(word) for word in row.split()] for row in out.splitlines())
    assert status == rig.words(image, 0, 80)
    assert coarse == rig.words(image, COARSE, 71)
    assert window == rig.words(image, WINDOW, COUNT)
    assert window[0] == window[-1] == 1
