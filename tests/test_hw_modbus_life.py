"""A Modbus server through its life: limits, pace, busy ports, lines that go and come, any bytes."""

import asyncio
import gc
import os
import random
import socket
import weakref
from pathlib import Path

import pytest

from hw.modbus_client import (
    ALL_BURST,
    ALL_HZ,
    BATCH,
    CLIENT_BURST,
    CLIENT_HZ,
    MOST_WAITING,
    Client,
    Pace,
)
from hw.modbus_frames import Request
from hw.modbus_handlers import IDLE_S, MOST_CONNECTIONS, SPARED_S, TcpHandler
from hw.modbus_server import ModbusServer
from hw.port_url import PortUrlError
from tests.modbus_rig import (
    READ_TEN,
    START_S,
    Clock,
    Line,
    Loop,
    Tcp,
    Udp,
    desk_of,
    free_port,
    new_image,
    read_request,
    serving,
    until,
)

READ = Request(1, bytes.fromhex("03 00 00 00 7D"))


def at_full_speed(clients: int, seconds: float) -> tuple[list[int], int]:
    """Answers of each of so many clients that ask again at once, and the most in one call."""
    clock = Clock()
    desk = desk_of(new_image(), clock)
    loop = desk.loop
    assert isinstance(loop, Loop)
    answers = [0] * clients
    asking: list[Client] = []

    def client_of(number: int) -> Client:
        def reply(request: Request, pdu: bytes) -> None:
            answers[number] += 1
            loop.call_soon(lambda: asking[number].offer([READ] * 3))

        return Client(desk, str(number), True, reply)

    asking += [client_of(number) for number in range(clients)]
    for client in asking:
        client.offer([READ])
    most = 0
    while loop.calls and clock.now_s < START_S + seconds:
        before = sum(answers)
        loop.step()
        most = max(most, sum(answers) - before)
    return answers, most


@pytest.mark.parametrize("clients", [1, 4, 8])
def test_clients_at_full_speed_are_slowed_fairly_and_no_call_takes_long(clients: int) -> None:
    seconds = 2.0
    answers, most = at_full_speed(clients, seconds)
    assert most <= BATCH
    assert max(answers) <= CLIENT_BURST + CLIENT_HZ * seconds + 1
    assert sum(answers) <= ALL_BURST + ALL_HZ * seconds + 1
    share = min(CLIENT_HZ, ALL_HZ / clients) * seconds
    assert min(answers) > 0.8 * share


def test_a_pace_allows_a_burst_after_a_rest_and_then_its_rate() -> None:
    pace, now_s = Pace(10.0, 3.0), START_S
    taken = []
    for _ in range(40):
        if pace.wait_s(now_s) == 0.0:
            pace.take()
            taken.append(round(now_s - START_S, 3))
        now_s += 0.05
    assert taken[:5] == [0.0, 0.05, 0.1, 0.15, 0.2]
    assert len(taken) == 3 + 19 or len(taken) == 3 + 20
    assert pace.wait_s(now_s - 5) >= 0.0  # a clock that goes back: no more, no less


def test_what_waits_for_a_client_is_bounded() -> None:
    desk = desk_of(new_image(), Clock())
    client = Client(desk, "me", True, lambda request, pdu: None)
    client.hold(True)
    assert client.offer([READ] * MOST_WAITING)
    assert not client.offer([READ] * 3)
    assert (client.waiting, desk.counters.dropped) == (MOST_WAITING, 3)
    client.hold(False)
    assert client.waiting == MOST_WAITING - BATCH
    client.close()
    assert client.waiting == 0


def test_a_client_that_takes_no_answers_fills_no_memory_and_stops_nobody() -> None:
    async def run() -> None:
        port, clock = free_port(), Clock()
        async with serving(f"tcp://127.0.0.1:{port}", new_image(), clock) as server:
            deaf = socket.create_connection(("127.0.0.1", port))
            deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
            deaf.setblocking(False)
            request = read_request(0, 125) * 50
            with pytest.raises(BlockingIOError):
                while True:  # its requests are taken until too many wait
                    clock.now_s += 1
                    deaf.send(request)
                    await asyncio.sleep(0)
                    if server.counters.dropped:
                        raise BlockingIOError
            await until(lambda: server.counters.dropped)
            other = await Tcp.connect(port)
            assert len(await other.ask(READ_TEN)) == 29
            other.close()
            deaf.close()

    asyncio.run(run())


def test_who_ends_asking_still_gets_the_answers() -> None:
    async def run() -> None:
        port, clock = free_port(), Clock()
        async with serving(f"tcp://127.0.0.1:{port}", new_image(), clock):
            client = await Tcp.connect(port)
            client.writer.write(READ_TEN * 10)
            client.writer.write_eof()
            assert len(await client.reader.read(-1)) == 29 * 10
            client.close()

    asyncio.run(run())


def test_there_is_room_for_so_many_connections_and_idle_ones_make_room() -> None:
    async def run() -> None:
        port, clock = free_port(), Clock()
        async with serving(f"tcp://127.0.0.1:{port}", new_image(), clock) as server:
            clients = [await Tcp.connect(port) for _ in range(MOST_CONNECTIONS)]
            for client in clients:
                assert len(await client.ask(READ_TEN)) == 29
            surplus = await Tcp.connect(port)
            assert await surplus.ended()
            assert server.counters.turned_away == 1
            clock.now_s += SPARED_S + 1
            for client in clients[1:]:
                await client.ask(READ_TEN)
            newcomer = await Tcp.connect(port)
            assert len(await newcomer.ask(READ_TEN)) == 29
            assert await clients[0].ended()
            clock.now_s += IDLE_S / 2
            await newcomer.ask(READ_TEN)
            clock.now_s += IDLE_S / 2 + 1
            await server.tend()
            assert server.counters.idle_closed == 1 + MOST_CONNECTIONS - 1
            assert await clients[1].ended()
            assert len(await newcomer.ask(READ_TEN)) == 29
            for client in [*clients, surplus, newcomer]:
                client.close()

    asyncio.run(run())


def test_connections_leave_nothing_behind_while_the_collector_is_off() -> None:
    async def run() -> None:
        port, clock = free_port(), Clock()
        url = f"tcp://127.0.0.1:{port}"
        async with serving(url, new_image(), clock) as server:
            service = server._service
            seen: list[weakref.ref[TcpHandler]] = []
            for k in range(20):
                client = await Tcp.connect(port)
                clock.now_s += 1.0
                await client.ask(READ_TEN)
                connections = service.connections  # type: ignore[union-attr]
                seen += [weakref.ref(handler) for handler in connections]
                if k % 2:
                    client.writer.write(b"\xff" * 20)
                    await client.ended()
                client.close()
                await until(lambda: not connections)
            await asyncio.sleep(0)
            assert len(seen) == 20
            await until(lambda: not any(handler() for handler in seen))

    gc.collect()
    gc.disable()
    try:
        asyncio.run(run())
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
        server.start()
        await until(lambda: "in use by another program" in server.status.cause)
        assert server.status.state == "closed"
        other.close()
        clock.now_s += 1
        await until(lambda: server.status.state == "running")
        assert server.status.cause == ""
        await server.stop()
        assert server.status.state == "closed"
        assert server.status.losses == 1

    asyncio.run(run())


def test_what_can_not_be_served_is_told_in_words(tmp_path: Path) -> None:
    async def run(url: str, cause: str) -> None:
        server = ModbusServer(url, new_image(), Clock())
        await server.tend()
        assert cause in server.status.cause
        await server.stop()

    asyncio.run(run("tcp://192.0.2.1:5020", "does not have the address 192.0.2.1"))
    asyncio.run(run(f"serial://{tmp_path}/none?baud=9600", "no such device"))
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
            assert (await first.ask(ask, 7)).hex() == "0503024d507cb8"
            first.close()
            await until(lambda: server.status.state == "closed")
            assert server.status.cause
            second = Line()
            path.unlink()
            path.symlink_to(second.path)
            clock.now_s += 10
            await until(lambda: server.status.state == "running")
            assert (await second.ask(ask, 7)).hex() == "0503024d507cb8"
            assert server.status.losses == 1
            second.close()

    asyncio.run(run())


def test_a_line_that_nobody_reads_does_not_stall_the_loop() -> None:
    async def run() -> None:
        line, clock = Line(), Clock()
        async with serving(line.url(), new_image(), clock) as server:
            ask = bytes.fromhex("01 04 00 00 00 7D 30 2B")
            for k in range(150):  # more answers than a pty keeps
                clock.now_s += 1.0
                os.write(line.master, ask)
                await until(lambda k=k: server.counters.requests > k)  # type: ignore[misc]
            assert server.status.state == "running"
            line.close()

    asyncio.run(run())


@pytest.mark.parametrize("kind", ["tcp", "udp", "serial"])
def test_random_bytes_never_end_the_server(kind: str) -> None:
    async def run() -> None:
        chance, clock, port = random.Random(5), Clock(), free_port()
        line = Line()
        url = line.url() if kind == "serial" else f"{kind}://127.0.0.1:{port}"
        async with serving(url, new_image(), clock) as server:
            for k in range(150):
                clock.now_s += 1.0
                junk = chance.randbytes(chance.randrange(1, 80))
                if k % 2:
                    junk = bytes((0, k, 0, 0, 0, chance.randrange(2, 12), 1)) + junk
                if kind == "serial":
                    line.send(junk)
                    line.listen()
                elif kind == "udp":
                    client = await Udp.connect(port)
                    client.send(junk)
                    client.close()
                else:
                    stream = await Tcp.connect(port)
                    stream.writer.write(junk)
                    await stream.writer.drain()
                    stream.close()
                await asyncio.sleep(0.001)
            assert server.status.state == "running"
            clock.now_s += 100
            if kind == "serial":
                await line.is_silent()
                line.heard.clear()
                assert (await line.ask(bytes.fromhex("01 03 00 00 00 0A C5 CD"), 25))[0] == 1
            else:
                asker = await (Tcp if kind == "tcp" else Udp).connect(port)
                assert len(await asker.ask(READ_TEN)) == 29
                asker.close()
        line.close()

    asyncio.run(run())
