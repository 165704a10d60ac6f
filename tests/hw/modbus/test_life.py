"""A Modbus server through its life: busy ports, lines that go and come, any bytes, no leaks."""

import asyncio
import gc
import socket
import weakref
from pathlib import Path
from typing import Any

import pytest

from hw.modbus.rtu import CALL_BYTES
from hw.modbus.server import ModbusServer, _why_closed
from hw.ports.url import PortUrlError, parse_url
from tests.support.modbus_rig import (
    READ_TEN,
    Clock,
    Line,
    Tcp,
    converse,
    free_port,
    new_image,
    serving,
    until,
)


def test_connections_leave_nothing_behind_while_the_collector_is_off() -> None:
    async def talk(client: Tcp, server: ModbusServer, clock: Clock) -> None:
        connections: Any = server._service.connections  # type: ignore[union-attr]
        seen: list[weakref.ref[object]] = []
        for k in range(20):
            clock.now_s += 1.0
            await client.ask(READ_TEN)
            seen += [weakref.ref(handler) for handler in connections]
            seen += [weakref.ref(handler._transport) for handler in connections]
            if k % 2:
                client.writer.write(b"\xff" * 20)
                await client.ended()
            client.close()
            await until(lambda: not connections)
            client = await client.another()
        assert len(seen) == 2 * 20
        await until(lambda: not any(handler() for handler in seen))
        client.close()

    gc.collect()
    gc.disable()
    try:
        converse("tcp", talk)
    finally:
        gc.enable()


@pytest.mark.parametrize("kind", ["tcp", "udp"])
def test_a_busy_port_is_told_and_taken_once_it_is_free(kind: str) -> None:
    async def run() -> None:
        number = socket.SOCK_STREAM if kind == "tcp" else socket.SOCK_DGRAM
        other = socket.socket(socket.AF_INET, number)
        other.bind(("127.0.0.1", 0))
        if kind == "tcp":
            other.listen()
        port, clock = other.getsockname()[1], Clock()
        server = ModbusServer(f"{kind}://127.0.0.1:{port}", new_image(), clock)
        await server.tend()
        assert "in use by another program" in server.status.cause
        assert server.status.state == "closed"
        other.close()
        clock.now_s += 1
        await server.tend()
        assert (server.status.state, server.status.cause) == ("running", "")
        await server.stop()
        assert (server.status.state, server.status.losses) == ("closed", 1)

    asyncio.run(run())


def test_what_can_not_be_served_is_told_in_words(tmp_path: Path) -> None:
    async def run(url: str, cause: str) -> None:
        server = ModbusServer(url, new_image(), Clock())
        await server.tend()
        assert cause in server.status.cause
        await server.stop()

    asyncio.run(run("tcp://192.0.2.1:5020", "does not have the address 192.0.2.1"))
    asyncio.run(run(f"serial://{tmp_path}/none?baud=9600", "no such device"))
    nobody = _why_closed(socket.gaierror(-2, "unknown"), parse_url("tcp://nobody:5020"))
    assert nobody == "the host 'nobody' has no known address"
    with pytest.raises(PortUrlError):
        ModbusServer("http://nowhere", new_image(), Clock())
    with pytest.raises(ValueError, match="unit must be within"):
        ModbusServer("tcp://127.0.0.1:5020", new_image(), Clock(), unit=239)


def test_a_line_with_parity_comes_back_after_it_was_lost(tmp_path: Path) -> None:
    async def run() -> None:
        first, clock = Line(), Clock()
        path = tmp_path / "line"
        path.symlink_to(first.path)
        url = f"serial://{path}?baud=19200&parity=E"
        async with serving(url, new_image(), clock, unit=5) as server:
            ask = bytes.fromhex("05 03 00 00 00 01 85 8E")
            assert (await first.ask(ask, 7)).hex() == "0503024d507ce8"
            first.close()
            await until(lambda: server.status.state == "closed")
            assert server.status.cause
            second = Line()
            path.unlink()
            path.symlink_to(second.path)
            clock.now_s += 10
            await until(lambda: server.status.state == "running")
            assert (await second.ask(ask, 7)).hex() == "0503024d507ce8"
            assert server.status.losses == 1
            second.close()

    asyncio.run(run())


def test_a_flood_on_a_line_is_looked_at_in_bounded_portions_and_in_order() -> None:
    async def talk(line: Line, server: ModbusServer, clock: Clock) -> None:
        service: Any = server._service
        line.send(bytes.fromhex("01 03 00 00 00 01 84 0A") * 400)
        answer, most = bytes.fromhex("01 03 02 4D 50 8D 28"), 0
        while len(line.listen()) < 400 * 7:
            clock.now_s += 0.01
            most = max(most, len(service._unread))
            await asyncio.sleep(0)
        assert bytes(line.heard) == answer * 400
        assert 400 * 8 - CALL_BYTES >= most > 0

    converse("serial", talk)


def test_a_mistake_of_ours_ends_the_server_and_is_not_kept_secret() -> None:
    async def run() -> None:
        def broken() -> float:
            raise ZeroDivisionError

        server = ModbusServer(f"tcp://127.0.0.1:{free_port()}", new_image(), broken)
        server.start()
        await until(lambda: server.status.cause == "ended by a mistake of ours")
        with pytest.raises(ZeroDivisionError):
            await server.stop()

    asyncio.run(run())
