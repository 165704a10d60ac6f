"""A Modbus server through its life: ports, lines that come and go, and what a client may take."""

import asyncio
import contextlib
import gc
import socket
import weakref
from pathlib import Path
from typing import Any

import pytest

from hw.modbus.client import BATCH, CLIENT_BURST, CLIENT_HZ, MOST_WAITING, Client, Request
from hw.modbus.image import ALL_BURST, ALL_HZ, TokenBucket
from hw.modbus.network import IDLE_S, MOST_CONNECTIONS, SPARED_S
from hw.modbus.rtu import CALL_BYTES
from hw.modbus.server import ModbusServer, _why_closed
from hw.ports.url import PortUrlError, parse_url
from tests.support.machine import modbus_rig as rig


def test_connections_leave_nothing_behind_while_the_collector_is_off() -> None:
    async def talk(client: rig.Tcp, server: ModbusServer, clock: rig.Clock) -> None:
        connections: Any = server._service.connections  # type: ignore[union-attr]
        seen: list[weakref.ref[object]] = []
        for k in range(20):
            clock.now_s += 1.0
            await client.ask(rig.READ_TEN)
            seen += [weakref.ref(handler) for handler in connections]
            seen += [weakref.ref(handler._transport) for handler in connections]
            if k % 2:
                client.writer.write(b"\xff" * 20)
                await client.ended()
            client.close()
            await rig.until(lambda: not connections)
            client = await client.another()
        assert len(seen) == 2 * 20
        await rig.until(lambda: not any(handler() for handler in seen))
        client.close()

    gc.collect()
    gc.disable()
    try:
        asyncio.run(rig.converse("tcp", talk))
    finally:
        gc.enable()


@pytest.mark.parametrize("kind", ["tcp", "udp"])
@rig.in_loop
async def test_a_busy_port_is_told_and_taken_once_it_is_free(kind: str) -> None:
    number = socket.SOCK_STREAM if kind == "tcp" else socket.SOCK_DGRAM
    other = socket.socket(socket.AF_INET, number)
    other.bind(("127.0.0.1", 0))
    if kind == "tcp":
        other.listen()
    port, clock = other.getsockname()[1], rig.Clock()
    server = ModbusServer(f"{kind}://127.0.0.1:{port}", rig.new_image(), clock)
    await server.tend()
    assert "in use by another program" in server.status.cause
    assert server.status.state == "closed"
    other.close()
    clock.now_s += 1
    await server.tend()
    assert (server.status.state, server.status.cause) == ("running", "")
    await server.stop()
    assert (server.status.state, server.status.losses) == ("closed", 1)


def test_what_can_not_be_served_is_told_in_words(tmp_path: Path) -> None:
    async def run(url: str, cause: str) -> None:
        server = ModbusServer(url, rig.new_image(), rig.Clock())
        await server.tend()
        assert cause in server.status.cause
        await server.stop()

    asyncio.run(run("tcp://192.0.2.1:5020", "does not have the address 192.0.2.1"))
    asyncio.run(run(f"serial://{tmp_path}/none?baud=9600", "no such device"))
    nobody = _why_closed(socket.gaierror(-2, "unknown"), parse_url("tcp://nobody:5020"))
    assert nobody == "the host 'nobody' has no known address"
    with pytest.raises(PortUrlError):
        ModbusServer("http://nowhere", rig.new_image(), rig.Clock())
    with pytest.raises(ValueError, match="unit must be within"):
        ModbusServer("tcp://127.0.0.1:5020", rig.new_image(), rig.Clock(), unit=239)


@rig.in_loop
async def test_a_line_with_parity_comes_back_after_it_was_lost(tmp_path: Path) -> None:
    first, clock = rig.Line(), rig.Clock()
    path = tmp_path / "line"
    path.symlink_to(first.path)
    url = f"serial://{path}?baud=19200&parity=E"
    async with rig.serving(url, rig.new_image(), clock, unit=5) as server:
        ask = bytes.fromhex("05 03 00 00 00 01 85 8E")
        assert (await first.ask(ask, 7)).hex() == "0503024d507ce8"
        first.close()
        await rig.until(lambda: server.status.state == "closed")
        assert server.status.cause
        second = rig.Line()
        path.unlink()
        path.symlink_to(second.path)
        clock.now_s += 10
        await rig.until(lambda: server.status.state == "running")
        assert (await second.ask(ask, 7)).hex() == "0503024d507ce8"
        assert server.status.losses == 1
        second.close()


@rig.talk("serial")
async def test_a_flood_on_a_line_is_looked_at_in_bounded_portions_and_in_order(
    line: rig.Line, server: ModbusServer, clock: rig.Clock
) -> None:
    service: Any = server._service
    line.send(bytes.fromhex("01 03 00 00 00 01 84 0A") * 400)
    answer, most = bytes.fromhex("01 03 02 4D 50 8D 28"), 0
    while len(line.listen()) < 400 * 7:
        clock.now_s += 0.01
        most = max(most, len(service._unread))
        await asyncio.sleep(0)
    assert bytes(line.heard) == answer * 400
    assert 400 * 8 - CALL_BYTES >= most > 0


@rig.in_loop
async def test_a_mistake_of_ours_ends_the_server_and_is_not_kept_secret() -> None:
    def broken() -> float:
        raise ZeroDivisionError

    server = ModbusServer(f"tcp://127.0.0.1:{rig.free_port()}", rig.new_image(), broken)
    server.start()
    await rig.until(lambda: server.status.cause == "ended by a mistake of ours")
    with pytest.raises(ZeroDivisionError):
        await server.stop()


READ = Request(1, bytes.fromhex("03 00 00 00 7D"))


@pytest.mark.parametrize("clients", [1, 8])
def test_clients_at_full_speed_are_slowed_fairly_and_no_call_takes_long(clients: int) -> None:
    """Each asks again at once."""
    loop = rig.Loop(rig.Clock())
    context = rig.context_of(rig.new_image(), loop)
    answers, asking, most = [0] * clients, list[Client](), 0

    def client_of(number: int) -> Client:
        def reply(request: Request, pdu: bytes) -> None:
            answers[number] += 1
            loop.call_soon(lambda: asking[number].offer([READ] * 3))

        return Client(context, str(number), True, reply)

    asking += [client_of(number) for number in range(clients)]
    for client in asking:
        client.offer([READ])
    seconds = 1.0
    while loop.calls and loop.clock.now_s < rig.START_S + seconds:
        before = sum(answers)
        loop.step()
        most = max(most, sum(answers) - before)
    assert most <= BATCH
    assert max(answers) <= CLIENT_BURST + CLIENT_HZ * seconds + 1
    assert sum(answers) <= ALL_BURST + ALL_HZ * seconds + 1
    assert min(answers) > 0.8 * min(CLIENT_HZ, ALL_HZ / clients) * seconds


def test_a_pace_allows_a_burst_after_a_rest_and_then_its_rate() -> None:
    pace = TokenBucket(10.0, 3.0)
    waits = [round(pace.book(rig.START_S), 6) for _ in range(6)]
    assert waits == [0.0, 0.0, 0.0, 0.1, 0.2, 0.3]
    assert [round(pace.book(rig.START_S + 9), 6) for _ in range(4)] == [0.0, 0.0, 0.0, 0.1]


def test_what_waits_for_a_client_is_bounded() -> None:
    context = rig.context_of(rig.new_image(), rig.Loop(rig.Clock()))
    client = Client(context, "me", True, lambda request, pdu: None)
    client.hold(True)
    assert client.offer([READ] * MOST_WAITING)
    assert not client.offer([READ] * 3)
    assert (client.waiting, context.status.rejected) == (MOST_WAITING, 1)
    client.hold(False)
    assert client.waiting == MOST_WAITING - BATCH
    client.close()
    assert client.waiting == 0


@rig.talk("tcp")
async def test_a_client_that_takes_no_answers_fills_no_memory_and_stops_nobody(
    client: rig.Tcp, server: ModbusServer, clock: rig.Clock
) -> None:
    deaf = socket.create_connection(client.writer.get_extra_info("peername"))
    deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    deaf.setblocking(False)
    request = rig.read_request(0, 125) * 50
    with contextlib.suppress(OSError):  # in the end the server closes it
        while not server.status.rejected:
            clock.now_s += 1
            with contextlib.suppress(BlockingIOError):
                deaf.send(request)
            await asyncio.sleep(0)
    assert len(await client.ask(rig.READ_TEN)) == 29
    deaf.close()


@rig.talk("tcp")
async def test_who_ends_asking_still_gets_the_answers(
    client: rig.Tcp, server: ModbusServer, clock: rig.Clock
) -> None:
    client.writer.write(rig.READ_TEN * 10)
    client.writer.write_eof()
    assert len(await client.reader.read(-1)) == 29 * 10


@rig.talk("tcp")
async def test_there_is_room_for_so_many_connections_and_idle_ones_make_room(
    client: rig.Tcp, server: ModbusServer, clock: rig.Clock
) -> None:
    clients = [client, *[await client.another() for _ in range(MOST_CONNECTIONS - 1)]]
    for one in clients:
        assert len(await one.ask(rig.READ_TEN)) == 29
    surplus = await client.another()
    assert await surplus.ended()
    [rejection] = server.status.rejections
    assert rejection.reason == "more connections than there is room for"
    clock.now_s += SPARED_S + 1
    for one in clients[1:]:
        await one.ask(rig.READ_TEN)
    newcomer = await clients[1].another()
    assert len(await newcomer.ask(rig.READ_TEN)) == 29
    assert await clients[0].ended()
    clock.now_s += IDLE_S / 2
    await newcomer.ask(rig.READ_TEN)
    clock.now_s += IDLE_S / 2 + 1
    await server.tend()
    assert await clients[1].ended()
    assert len(await newcomer.ask(rig.READ_TEN)) == 29
    for one in [*clients[1:], surplus, newcomer]:
        one.close()


@rig.in_loop
async def test_each_port_has_views_of_its_own_and_all_share_one_pace() -> None:
    image, clock = rig.new_image(), rig.Clock()
    one, other = rig.free_port(), rig.free_port()
    async with (
        rig.serving(f"tcp://127.0.0.1:{one}", image, clock),
        rig.serving(f"tcp://127.0.0.1:{other}", image, clock, unit=2),
    ):
        first, second = await rig.Tcp.connect(one), await rig.Tcp.connect(other)
        assert rig.words_of(await first.ask(rig.read_request(1000, 1, unit=3))) == [1]
        image.publish(rig.START_S + 0.1, rig.GOOD, rig.CLEAR, rig.window_of(rig.some_cells(2)))
        clock.now_s += 0.1
        assert rig.words_of(await second.ask(rig.read_request(1000, 1, unit=3))) == [2]
        assert rig.words_of(await second.ask(rig.read_request(90, 1, unit=10))) == [0]
        assert rig.words_of(await first.ask(rig.read_request(90, 1, unit=3))) == [1]
        for _ in range(int(ALL_BURST)):
            image.pace.book(clock.now_s)
        assert image.pace.book(clock.now_s) > 0
        first.close()
        second.close()
