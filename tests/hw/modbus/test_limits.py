"""What a Modbus client may take: its pace, what waits for it, and how many there may be."""

import asyncio
import contextlib
import socket

import pytest

from hw.modbus.client import (
    BATCH,
    CLIENT_BURST,
    CLIENT_HZ,
    MOST_WAITING,
    Client,
    Request,
)
from hw.modbus.image import ALL_BURST, ALL_HZ, TokenBucket
from hw.modbus.network import IDLE_S, MOST_CONNECTIONS, SPARED_S
from hw.modbus.server import ModbusServer
from tests.support.modbus_rig import (
    CLEAR,
    GOOD,
    READ_TEN,
    START_S,
    Clock,
    Loop,
    Tcp,
    context_of,
    converse,
    free_port,
    new_image,
    read_request,
    serving,
    some_cells,
    window_of,
    words_of,
)

READ = Request(1, bytes.fromhex("03 00 00 00 7D"))


@pytest.mark.parametrize("clients", [1, 8])
def test_clients_at_full_speed_are_slowed_fairly_and_no_call_takes_long(clients: int) -> None:
    """Each asks again at once."""
    loop = Loop(Clock())
    context = context_of(new_image(), loop)
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
    while loop.calls and loop.clock.now_s < START_S + seconds:
        before = sum(answers)
        loop.step()
        most = max(most, sum(answers) - before)
    assert most <= BATCH
    assert max(answers) <= CLIENT_BURST + CLIENT_HZ * seconds + 1
    assert sum(answers) <= ALL_BURST + ALL_HZ * seconds + 1
    assert min(answers) > 0.8 * min(CLIENT_HZ, ALL_HZ / clients) * seconds


def test_a_pace_allows_a_burst_after_a_rest_and_then_its_rate() -> None:
    pace = TokenBucket(10.0, 3.0)
    waits = [round(pace.book(START_S), 6) for _ in range(6)]
    assert waits == [0.0, 0.0, 0.0, 0.1, 0.2, 0.3]
    assert [round(pace.book(START_S + 9), 6) for _ in range(4)] == [0.0, 0.0, 0.0, 0.1]


def test_what_waits_for_a_client_is_bounded() -> None:
    context = context_of(new_image(), Loop(Clock()))
    client = Client(context, "me", True, lambda request, pdu: None)
    client.hold(True)
    assert client.offer([READ] * MOST_WAITING)
    assert not client.offer([READ] * 3)
    assert (client.waiting, context.status.rejected) == (MOST_WAITING, 1)
    client.hold(False)
    assert client.waiting == MOST_WAITING - BATCH
    client.close()
    assert client.waiting == 0


def test_a_client_that_takes_no_answers_fills_no_memory_and_stops_nobody() -> None:
    async def talk(client: Tcp, server: ModbusServer, clock: Clock) -> None:
        deaf = socket.create_connection(client.writer.get_extra_info("peername"))
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        deaf.setblocking(False)
        request = read_request(0, 125) * 50
        with contextlib.suppress(OSError):  # in the end the server closes it
            while not server.status.rejected:
                clock.now_s += 1
                with contextlib.suppress(BlockingIOError):
                    deaf.send(request)
                await asyncio.sleep(0)
        assert len(await client.ask(READ_TEN)) == 29
        deaf.close()

    converse("tcp", talk)


def test_who_ends_asking_still_gets_the_answers() -> None:
    async def talk(client: Tcp, server: ModbusServer, clock: Clock) -> None:
        client.writer.write(READ_TEN * 10)
        client.writer.write_eof()
        assert len(await client.reader.read(-1)) == 29 * 10

    converse("tcp", talk)


def test_there_is_room_for_so_many_connections_and_idle_ones_make_room() -> None:
    async def talk(client: Tcp, server: ModbusServer, clock: Clock) -> None:
        clients = [client, *[await client.another() for _ in range(MOST_CONNECTIONS - 1)]]
        for one in clients:
            assert len(await one.ask(READ_TEN)) == 29
        surplus = await client.another()
        assert await surplus.ended()
        [rejection] = server.status.rejections
        assert rejection.reason == "more connections than there is room for"
        clock.now_s += SPARED_S + 1
        for one in clients[1:]:
            await one.ask(READ_TEN)
        newcomer = await clients[1].another()
        assert len(await newcomer.ask(READ_TEN)) == 29
        assert await clients[0].ended()
        clock.now_s += IDLE_S / 2
        await newcomer.ask(READ_TEN)
        clock.now_s += IDLE_S / 2 + 1
        await server.tend()
        assert await clients[1].ended()
        assert len(await newcomer.ask(READ_TEN)) == 29
        for one in [*clients[1:], surplus, newcomer]:
            one.close()

    converse("tcp", talk)


def test_each_port_has_views_of_its_own_and_all_share_one_pace() -> None:
    async def run() -> None:
        image, clock = new_image(), Clock()
        one, other = free_port(), free_port()
        async with (
            serving(f"tcp://127.0.0.1:{one}", image, clock),
            serving(f"tcp://127.0.0.1:{other}", image, clock, unit=2),
        ):
            first, second = await Tcp.connect(one), await Tcp.connect(other)
            assert words_of(await first.ask(read_request(1000, 1, unit=3))) == [1]
            image.publish(START_S + 0.1, GOOD, CLEAR, window_of(some_cells(2)))
            clock.now_s += 0.1
            assert words_of(await second.ask(read_request(1000, 1, unit=3))) == [2]
            assert words_of(await second.ask(read_request(90, 1, unit=10))) == [0]
            assert words_of(await first.ask(read_request(90, 1, unit=3))) == [1]
            for _ in range(int(ALL_BURST)):
                image.pace.book(clock.now_s)
            assert image.pace.book(clock.now_s) > 0
            first.close()
            second.close()

    asyncio.run(run())
