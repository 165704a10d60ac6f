"""Modbus byte for byte on TCP, UDP and a serial line: frames of the standard, and every fault that
pymodbus's server had on the wire. Time stands still."""

import asyncio

from hw.modbus.rtu import UNKNOWN, crc16, request_size
from hw.modbus.server import ModbusServer
from tests.support.machine import modbus_rig as rig

HEAD = bytes.fromhex("4D50 0100 0001 0000 0000 0007 6D61 706F 6400 0000")
TCP_ANSWER = bytes.fromhex("00 01 00 00 00 17 01 03 14") + HEAD
GARBAGE = [  # of another protocol, too short, too long
    bytes.fromhex("00 01 00 01 00 06 01 03 00 00 00 01"),
    bytes.fromhex("00 01 00 00 00 01 01 03"),
    bytes.fromhex("00 01 00 00 00 FF 01 03"),
]
RTU_READ_TEN = bytes.fromhex("01 03 00 00 00 0A C5 CD")


def framed(pdu: str, unit: int = 1) -> bytes:
    frame = bytes((unit,)) + bytes.fromhex(pdu)
    return frame + crc16(frame).to_bytes(2, "little")


READ_MAGIC, MAGIC = framed("03 00 00 00 01"), framed("03 02 4D50")


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
    ("06 00 01 00 03", "86 02"),
    ("0F 00 00 00 08 01 FF", "8F 02"),
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


@rig.talk("tcp", "udp")
async def test_refusals_have_the_function_and_the_code_of_the_standard(
    client: rig.Tcp | rig.Udp, server: ModbusServer, clock: rig.Clock
) -> None:
    for number, (pdu, refusal) in enumerate(REFUSED):
        answer = rig.mbap(bytes.fromhex(refusal), number=number)
        assert await client.ask(rig.mbap(bytes.fromhex(pdu), number=number)) == answer, pdu


@rig.talk("serial")
async def test_refusals_are_the_same_on_a_line_even_of_functions_whose_length_nobody_knows(
    line: rig.Line, server: ModbusServer, clock: rig.Clock
) -> None:
    sizes = [(framed(pdu), framed(refusal)) for pdu, refusal in REFUSED if pdu != "83"]
    whole = [row for row in sizes if request_size(row[0]) in (len(row[0]), UNKNOWN)]
    assert len(whole) > 16
    for request, answer in whole[::3]:
        assert await line.ask(request, len(answer)) == answer, request.hex(" ")
    line.send(framed("83"))  # no answer: the next one heard is the next request's
    assert await line.ask(READ_MAGIC, 7) == MAGIC


@rig.talk("serial")
async def test_frames_on_a_line_are_answered_byte_for_byte(
    line: rig.Line, server: ModbusServer, clock: rig.Clock
) -> None:
    answer = framed("03 14" + HEAD.hex())
    assert await line.ask(RTU_READ_TEN, len(answer)) == answer
    long = await line.ask(bytes.fromhex("01 04 00 00 00 7D 30 2B"), 255)
    assert long[:3] == bytes.fromhex("01 04 FA")
    assert crc16(long) == 0
    for request, refusal in (
        ("01 04 00 C8 00 7D B1 D5", "84 02"),
        ("01 06 00 01 00 03 98 0B", "86 02"),
        ("01 10 00 05 00 02 04 00 01 00 02 E3 91", "90 02"),
    ):
        assert await line.ask(bytes.fromhex(request), 5) == framed(refusal)
    assert await line.ask(framed("06 00 5A 00 01"), 8) == framed("06 00 5A 00 01")
    texts = await line.ask(bytes.fromhex("01 2B 0E 01 00 70 77"), 28)
    assert texts == framed("2B 0E 01 82 00 00 03 00 05 6D61706F64 01 02 4D50 02 05 302E312E30")
    assert await line.ask(READ_MAGIC * 2, 14) == MAGIC * 2  # no silence between them


@rig.talk("tcp", "udp")
async def test_reads_are_answered_byte_for_byte_and_in_order_on_our_units_alone(
    client: rig.Tcp | rig.Udp, server: ModbusServer, clock: rig.Clock
) -> None:
    assert await client.ask(rig.READ_TEN) == TCP_ANSWER
    inputs = rig.READ_TEN.replace(b"\x03", b"\x04")
    assert await client.ask(inputs) == TCP_ANSWER.replace(b"\x01\x03\x14", b"\x01\x04\x14")
    assert len(rig.words_of(await client.ask(rig.read_request(0, 125)))) == 125
    for unit in (0, 1, 2, 9, 255):
        assert (await client.ask(rig.read_request(0, 1, unit)))[7:] == bytes.fromhex("03024D50")
    for unit in (10, 17, 247, 254):
        assert await client.ask(rig.read_request(0, 1, unit)) == rig.mbap(b"\x83\x0b", unit)
    pieces = [rig.read_request(k, 1, number=k) for k in range(12)]
    answers = [await client.ask(b"".join(pieces))]
    answers += [await client.answer() for _ in range(11)]
    assert [answer[:2] for answer in answers] == [p[:2] for p in pieces]
    assert b"".join(answer[9:] for answer in answers)[:20] == HEAD


@rig.talk("tcp")
async def test_a_request_may_come_a_byte_at_a_time(
    client: rig.Tcp, server: ModbusServer, clock: rig.Clock
) -> None:
    for at in range(len(rig.READ_TEN)):
        client.writer.write(rig.READ_TEN[at : at + 1])
        await client.writer.drain()
        await asyncio.sleep(0)
    assert await client.answer() == TCP_ANSWER
    assert server.status.rejected == 0


@rig.talk("udp")
async def test_a_datagram_is_one_whole_request(
    client: rig.Udp, server: ModbusServer, clock: rig.Clock
) -> None:
    client.send(rig.READ_TEN[:-1])
    client.send(rig.READ_TEN + b"\0")
    client.send(rig.READ_TEN * 5000)  # not even looked at
    for garbage in GARBAGE:
        client.send(garbage)
    assert await client.ask(rig.READ_TEN) == TCP_ANSWER
    assert server.status.rejected == 3 + len(GARBAGE)
    assert client.heard.empty()


@rig.talk("udp")
async def test_two_udp_clients_at_the_same_moment_get_each_its_own_answer(
    client: rig.Udp, server: ModbusServer, clock: rig.Clock
) -> None:
    other = await client.another()
    for k in range(5):
        client.send(rig.read_request(0, 1, number=100 + k))
        other.send(rig.read_request(1, 1, number=200 + k))
    for k in range(5):
        assert (await client.answer()).hex() == f"{100 + k:04x}00000005010302" + "4d50"
        assert (await other.answer()).hex() == f"{200 + k:04x}00000005010302" + "0100"
    assert client.heard.empty()
    assert other.heard.empty()
    other.close()


@rig.talk("tcp")
async def test_garbage_ends_a_connection(
    client: rig.Tcp, server: ModbusServer, clock: rig.Clock
) -> None:
    for k, garbage in enumerate(GARBAGE):
        one = await client.another()
        assert await one.ask(rig.READ_TEN + garbage) == TCP_ANSWER
        assert await one.ended()
        one.close()
        assert server.status.rejected == k + 1
    assert await client.ask(rig.READ_TEN) == TCP_ANSWER


@rig.talk("serial")
async def test_noise_before_a_request_does_not_make_the_line_deaf(
    line: rig.Line, server: ModbusServer, clock: rig.Clock
) -> None:
    wrong = READ_MAGIC[:-1] + b"\x00"
    for noise in ("00", "01", "01 03", "FF 00 17", "01 10 00 00 00 7B F6 55", wrong.hex()):
        assert await line.ask(bytes.fromhex(noise) + READ_MAGIC, 7) == MAGIC
    assert server.status.skipped_bytes >= len(wrong)
