"""Modbus byte for byte on TCP, UDP and a serial line: frames of the standard, and every fault that
the stock server of pymodbus 3.16 has on the wire. Time stands still."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pymodbus
import pytest

from hw.modbus.framing import UNKNOWN, crc16, request_size
from hw.modbus.handlers import TcpHandler, UdpHandler
from hw.modbus.server import PYMODBUS, ModbusServer
from tests.support.modbus_rig import (
    READ_TEN,
    Clock,
    Line,
    Tcp,
    Udp,
    free_port,
    mbap,
    new_image,
    read_request,
    serving,
    words_of,
)

HEAD = bytes.fromhex("4D50 0100 0001 0000 0000 0007 6D61 706F 6400 0000")
TCP_ANSWER = bytes.fromhex("00 01 00 00 00 17 01 03 14") + HEAD
RTU_READ_TEN = bytes.fromhex("01 03 00 00 00 0A C5 CD")

NETWORKS = pytest.mark.parametrize("kind", ["tcp", "udp"])


def framed(pdu: str, unit: int = 1) -> bytes:
    """On a line, with its checksum."""
    frame = bytes((unit,)) + bytes.fromhex(pdu)
    return frame + crc16(frame).to_bytes(2, "little")


def on_network(kind: str, talk: Callable[[Any, ModbusServer], Coroutine[Any, Any, None]]) -> None:
    """Run a conversation with a server on a fresh port."""

    async def run() -> None:
        port = free_port()
        async with serving(f"{kind}://127.0.0.1:{port}", new_image(), Clock()) as server:
            client = await (Tcp if kind == "tcp" else Udp).connect(port)
            await talk(client, server)
            client.close()

    asyncio.run(run())


def on_line(talk: Callable[[Line, ModbusServer], Coroutine[Any, Any, None]]) -> None:
    """Run a conversation with a server on a pty."""

    async def run() -> None:
        line = Line()
        async with serving(line.url(), new_image(), Clock()) as server:
            await talk(line, server)
        line.close()

    asyncio.run(run())


def test_the_handlers_stand_on_this_version_of_pymodbus() -> None:
    assert pymodbus.__version__.startswith(PYMODBUS)
    entry_points = {"connection_made", "data_received", "eof_received", "connection_lost"}
    assert entry_points <= set(vars(TcpHandler))
    assert "datagram_received" in vars(UdpHandler)


REFUSED = [
    ("63", "E3 01"),  # a function that there is not
    ("07", "87 01"),
    ("08 00 00 12 34", "88 01"),
    ("83", "83 01"),
    ("03 00 00 00 00", "83 03"),  # counts
    ("04 00 00 00 7E", "84 03"),
    ("03 00 00 00", "83 03"),  # too short, too long
    ("03 00 00 00 01 00", "83 03"),
    ("01 00 00 07 D1", "81 03"),
    ("02 FF FF 00 01", "82 02"),  # addresses
    ("03 EA 60 00 01", "83 02"),
    ("04 00 AA 00 02", "84 02"),
    ("05 00 01 FF 00", "85 02"),  # nothing of this can be written
    ("05 00 01 12 34", "85 03"),
    ("06 00 01 00 03", "86 02"),
    ("0F 00 00 00 08 01 FF", "8F 02"),
    ("0F 00 00 00 08 02 FF", "8F 03"),
    ("0F 00 00 07 B1 F7 00", "8F 03"),
    ("10 00 05 00 02 04 00 01 00 02", "90 02"),
    ("10 00 05 00 02 03 00 01 00 02", "90 03"),
    ("16 00 04 00 F2 00 25", "96 02"),
    ("17 00 00 00 01 00 05 00 01 02 00 01", "97 02"),
    ("17 00 00 00 7E 00 5A 00 01 02 00 01", "97 03"),
    ("17 EA 60 00 01 00 5A 00 01 02 00 01", "97 02"),
    ("2B 0D 01 00", "AB 01"),
    ("2B 0E 05 00", "AB 03"),
    ("2B 0E 04 07", "AB 02"),
]


@NETWORKS
def test_refusals_have_the_function_and_the_code_of_the_standard(kind: str) -> None:
    async def talk(client: Tcp | Udp, server: ModbusServer) -> None:
        for number, (pdu, refusal) in enumerate(REFUSED):
            answer = mbap(bytes.fromhex(refusal), number=number)
            assert await client.ask(mbap(bytes.fromhex(pdu), number=number)) == answer, pdu

    on_network(kind, talk)


def test_refusals_are_the_same_on_a_line_even_of_functions_whose_length_nobody_knows() -> None:
    async def talk(line: Line, server: ModbusServer) -> None:
        sizes = [(framed(pdu), framed(refusal)) for pdu, refusal in REFUSED if pdu != "83"]
        whole = [row for row in sizes if request_size(row[0]) in (len(row[0]), UNKNOWN)]
        assert len(whole) > 16
        for request, answer in whole:
            assert await line.ask(request, len(answer)) == answer, request.hex(" ")
        line.send(framed("83"))
        assert await line.is_silent()

    on_line(talk)


@NETWORKS
def test_a_read_is_answered_byte_for_byte_by_both_codes(kind: str) -> None:
    async def talk(client: Tcp | Udp, server: ModbusServer) -> None:
        assert await client.ask(READ_TEN) == TCP_ANSWER
        inputs = READ_TEN.replace(b"\x03", b"\x04")
        assert await client.ask(inputs) == TCP_ANSWER.replace(b"\x01\x03\x14", b"\x01\x04\x14")
        assert len(words_of(await client.ask(read_request(0, 125)))) == 125

    on_network(kind, talk)


def test_frames_on_a_line_are_answered_byte_for_byte() -> None:
    async def talk(line: Line, server: ModbusServer) -> None:
        answer = bytes.fromhex("01 03 14") + HEAD
        answer += crc16(answer).to_bytes(2, "little")
        assert await line.ask(RTU_READ_TEN, len(answer)) == answer
        long = await line.ask(bytes.fromhex("01 04 00 00 00 7D 30 2B"), 255)
        assert long[:3] == bytes.fromhex("01 04 FA")
        assert crc16(long) == 0
        beyond = bytes.fromhex("01 04 00 C8 00 7D B1 D5")
        assert await line.ask(beyond, 5) == framed("84 02")
        assert await line.ask(bytes.fromhex("01 06 00 01 00 03 98 0B"), 5) == framed("86 02")
        many = bytes.fromhex("01 10 00 05 00 02 04 00 01 00 02 E3 91")
        assert await line.ask(many, 5) == framed("90 02")
        assert await line.ask(framed("06 00 5A 00 01"), 8) == framed("06 00 5A 00 01")
        texts = await line.ask(bytes.fromhex("01 2B 0E 01 00 70 77"), 28)
        assert texts == framed("2B 0E 01 82 00 00 03 00 05 6D61706F64 01 02 4D50 02 05 302E312E30")

    on_line(talk)


@NETWORKS
def test_every_one_of_several_requests_in_one_piece_is_answered_in_order(kind: str) -> None:
    async def talk(client: Any, server: ModbusServer) -> None:
        pieces = [read_request(k, 1, number=k) for k in range(12)]
        first = await client.ask(b"".join(pieces))
        rest = [await (client.answer() if kind == "tcp" else client.heard.get()) for _ in range(11)]
        assert [answer[:2] for answer in [first, *rest]] == [p[:2] for p in pieces]
        assert b"".join(answer[9:] for answer in [first, *rest])[:20] == HEAD

    on_network(kind, talk)


def test_two_requests_without_silence_between_them_are_both_answered_on_a_line() -> None:
    async def talk(line: Line, server: ModbusServer) -> None:
        answer = framed("03 02 4D50")
        assert await line.ask(framed("03 00 00 00 01") * 2, 14) == answer * 2

    on_line(talk)


@NETWORKS
def test_a_request_may_come_a_byte_at_a_time_unless_it_is_a_datagram(kind: str) -> None:
    async def talk(client: Any, server: ModbusServer) -> None:
        if kind == "udp":
            client.send(READ_TEN[:-1])
            client.send(READ_TEN + b"\0")
            client.send(READ_TEN * 5000)  # not even looked at
        else:
            for at in range(len(READ_TEN) - 1):
                client.writer.write(READ_TEN[at : at + 1])
                await client.writer.drain()
                await asyncio.sleep(0)
            client.writer.write(READ_TEN[-1:])
        assert await (client.ask(READ_TEN) if kind == "udp" else client.answer()) == TCP_ANSWER
        assert server.status.rejected == (3 if kind == "udp" else 0)

    on_network(kind, talk)


def test_two_udp_clients_at_the_same_moment_get_each_its_own_answer() -> None:
    async def talk(client: Udp, server: ModbusServer) -> None:
        assert client.transport is not None
        other = await Udp.connect(client.transport.get_extra_info("peername")[1])
        for k in range(5):
            client.send(read_request(0, 1, number=100 + k))
            other.send(read_request(1, 1, number=200 + k))
        for k in range(5):
            assert (await client.heard.get()).hex() == f"{100 + k:04x}00000005010302" + "4d50"
            assert (await other.heard.get()).hex() == f"{200 + k:04x}00000005010302" + "0100"
        assert client.heard.empty()
        assert other.heard.empty()
        other.close()

    on_network("udp", talk)


@pytest.mark.parametrize(
    "garbage",
    ["00 01 00 01 00 06 01 03 00 00 00 01", "00 01 00 00 00 01 01 03", "00 01 00 00 00 FF 01 03"],
    ids=["another protocol", "too short", "too long"],
)
def test_garbage_ends_a_connection_and_drops_a_datagram(garbage: str) -> None:
    async def on_tcp(client: Tcp, server: ModbusServer) -> None:
        assert await client.ask(READ_TEN + bytes.fromhex(garbage)) == TCP_ANSWER
        assert await client.ended()
        assert server.status.rejected == 1
        again = await Tcp.connect(client.writer.get_extra_info("peername")[1])
        assert await again.ask(READ_TEN) == TCP_ANSWER
        again.close()

    async def on_udp(client: Udp, server: ModbusServer) -> None:
        client.send(bytes.fromhex(garbage))
        assert await client.ask(READ_TEN) == TCP_ANSWER
        assert client.heard.empty()

    on_network("tcp", on_tcp)
    on_network("udp", on_udp)


@NETWORKS
def test_units_that_are_not_ours_are_refused_on_a_network(kind: str) -> None:
    async def talk(client: Tcp | Udp, server: ModbusServer) -> None:
        for unit in (0, 1, 2, 9, 255):
            assert (await client.ask(read_request(0, 1, unit)))[7:] == bytes.fromhex("03024D50")
        for unit in (10, 17, 247, 254):
            assert await client.ask(read_request(0, 1, unit)) == mbap(b"\x83\x0b", unit)

    on_network(kind, talk)


def test_only_our_own_units_are_answered_on_a_line() -> None:
    async def talk(line: Line, server: ModbusServer) -> None:
        for unit in (0, *range(3, 256)):
            line.send(framed("03 00 00 00 01", unit))
        line.send(framed("06 00 5A 00 01", 0))  # a broadcast: never answered
        assert await line.is_silent()
        assert await line.ask(framed("03 00 00 00 01", 2), 7) == framed("03 02 4D50", 2)

    on_line(talk)


def test_what_other_slaves_say_is_no_request_whatever_their_bytes_are() -> None:
    inside = RTU_READ_TEN + RTU_READ_TEN[:2]

    async def talk(line: Line, server: ModbusServer) -> None:
        line.send(framed("03 00 00 00 05", 17))
        line.send(framed("03 0A" + inside.hex(), 17))
        line.send(framed("83 02", 17))
        line.send(framed("03 02 00 05", 17) + framed("06 00 01 00 03", 17) * 2)
        assert await line.is_silent()
        assert await line.ask(framed("03 00 00 00 01"), 7) == framed("03 02 4D50")

    on_line(talk)


@pytest.mark.parametrize("noise", ["00", "01", "01 03", "FF 00 17", "01 10 00 00 00 7B F6 55"])
def test_noise_before_a_request_does_not_make_the_line_deaf(noise: str) -> None:
    async def talk(line: Line, server: ModbusServer) -> None:
        answer = framed("03 02 4D50")
        assert await line.ask(bytes.fromhex(noise) + framed("03 00 00 00 01"), 7) == answer
        wrong = framed("03 00 00 00 01")[:-1] + b"\x00"
        line.send(wrong)
        assert await line.is_silent()
        assert await line.ask(framed("03 00 00 00 01"), 7) == answer
        assert server.status.skipped_bytes >= len(wrong)

    on_line(talk)
