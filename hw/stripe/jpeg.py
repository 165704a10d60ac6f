"""Whether a JPEG has all of its image: its codes are followed to their end, and nothing is decoded.

A decoder makes an image of whatever it gets. Where bytes are missing in the middle, as a camera's
own bus loses them, all that comes behind moves up: a line is then seen where none is. So the
image's blocks are counted. What is lost within one block, and costs none, may stay unseen.

Baseline JPEG with one scan, as web cameras send it; any other can't be checked, and is told as
such. Cameras on USB leave the tables out, which are then those of annex K.
Source: ITU-T T.81, annexes B, F and K.3.
"""

import numpy as np
from msgspec import Struct

from core.records import I32, U8
from jit import kernel

BASELINE = (0xC0, 0xC1)
OTHERS = {*range(0xC2, 0xD0)} - {0xC4, 0xC8, 0xCC}  # progressive, lossless and the like
TABLES, RESTART, SCAN = 0xC4, 0xDD, 0xDA
LENGTHS, SYMBOLS = 17, 256  # of codes, 1..16; of a table
KINDS = 8  # of tables: four for a block's first number, four for its others
MOST_BLOCKS = 10  # in a unit
QUICK_BITS = 9  # codes so long or shorter are looked up at once: nearly all
MOST_HELD = 32  # bits before more are read; a symbol takes 31 at most: code and number behind it
USUAL_TABLES = bytes.fromhex(  # annex K.3 as a segment
    "ffc401a20000010501010101010100000000000000000102030405060708090a0b"
    "100002010303020403050504040000017d01020300041105122131410613516107227114328191a1082342b1c115"
    "52d1f02433627282090a161718191a25262728292a3435363738393a434445464748494a535455565758595a6364"
    "65666768696a737475767778797a838485868788898a92939495969798999aa2a3a4a5a6a7a8a9aab2b3b4b5b6b7"
    "b8b9bac2c3c4c5c6c7c8c9cad2d3d4d5d6d7d8d9dae1e2e3e4e5e6e7e8e9eaf1f2f3f4f5f6f7f8f9fa"
    "0100030101010101010101010000000000000102030405060708090a0b"
    "110002010204040304070504040001027700010203110405213106124151076171132232810"
    "8144291a1b1c109233352f0156272d10a162434e125f11718191a262728292a35363738393a434445464748494a5"
    "35455565758595a636465666768696a737475767778797a82838485868788898a92939495969798999aa2a3a4a5a"
    "6a7a8a9aab2b3b4b5b6b7b8b9bac2c3c4c5c6c7c8c9cad2d3d4d5d6d7d8d9dae2e3e4e5e6e7e8e9eaf2f3f4f5f6f"
    "7f8f9fa"
)
UNCHECKED = "a JPEG that can't be checked: it is no baseline one of one scan, or lacks its tables"
TORN = "a JPEG that lacks part of its image"


class Tables(Struct, frozen=True, eq=False):
    """Huffman codes by kind and length."""

    firsts: I32  # (KINDS, LENGTHS) the first code of a length,
    counts: I32  # (KINDS, LENGTHS) how many there are,
    places: I32  # (KINDS, LENGTHS) and where their symbols begin
    symbols: U8  # (KINDS, SYMBOLS)
    quick: I32  # (KINDS, 1 << QUICK_BITS) by the next bits: a code's length, times 256, and symbol


class Frame(Struct):
    """What the segments before the scan tell."""

    size: tuple[int, int] = (0, 0)  # width and height
    samplings: dict[int, tuple[int, int]] = {}  # of a component, across and down
    restart: int = 0  # units between two restarts; 0: none
    known: set[int] = set()  # kinds of tables that came


def fault_of_image(data: bytes) -> str:
    """Why a JPEG is not whole; "" if it is."""
    tables, frame, at = no_tables(), Frame(), 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xFF:  # filling
            at += 1
            continue
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        segment = data[at + 4 : at + 2 + length]
        if marker in OTHERS or length < 2 or len(segment) != length - 2:
            return UNCHECKED
        if marker == SCAN:
            return _fault_of_scan(data, at + 2 + length, segment, frame, tables)
        if not _take_in(marker, segment, frame, tables):
            return UNCHECKED
        at += 2 + length
    return UNCHECKED


def with_tables(data: bytes) -> bytes:
    """A JPEG that has no table of codes at all, with the usual ones; any other as it is."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != TABLES:
        if data[at + 1] == SCAN:
            return data[:at] + USUAL_TABLES + data[at:]
        at += 1 if data[at + 1] == 0xFF else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return data


def no_tables() -> Tables:
    firsts, counts, places = np.zeros((3, KINDS, LENGTHS), np.int32)
    quick = np.zeros((KINDS, 1 << QUICK_BITS), np.int32)
    return Tables(firsts, counts, places, np.zeros((KINDS, SYMBOLS), np.uint8), quick)


def warm() -> None:
    """Run the kernel once, so that it is not compiled while a robot drives."""
    one, plan = no_tables(), np.zeros((1, 2), np.int32)
    end = np.frombuffer(b"\xff\xd9", np.uint8)
    fill_quick(one.firsts, one.counts, one.places, one.symbols, one.quick)
    is_whole(end, 0, one.firsts, one.counts, one.places, one.symbols, one.quick, plan, 0, 0)


def _take_in(marker: int, segment: bytes, frame: Frame, tables: Tables) -> bool:
    """What a segment tells; False if that can't be."""
    if marker in BASELINE:
        if len(segment) < 6 or len(segment) != 6 + 3 * segment[5]:
            return False
        frame.size = int.from_bytes(segment[3:5], "big"), int.from_bytes(segment[1:3], "big")
        for one in range(6, len(segment), 3):
            frame.samplings[segment[one]] = segment[one + 1] >> 4, segment[one + 1] & 15
        return all(1 <= part <= 4 for pair in frame.samplings.values() for part in pair)
    if marker == RESTART:
        frame.restart = int.from_bytes(segment, "big")
        return len(segment) == 2
    while marker == TABLES and segment:
        counts = segment[1:LENGTHS]
        kind, symbols = _kind(segment[0]), segment[LENGTHS : LENGTHS + sum(counts)]
        if kind < 0 or len(counts) != 16 or len(symbols) != sum(counts) or len(symbols) > SYMBOLS:
            return False
        code = place = 0
        for size, count in enumerate(counts, 1):
            tables.firsts[kind, size], tables.counts[kind, size] = code, count
            tables.places[kind, size] = place
            code, place = (code + count) * 2, place + count
            if code > 2 << size:
                return False
        tables.symbols[kind, : len(symbols)] = np.frombuffer(symbols, np.uint8)
        frame.known.add(kind)
        segment = segment[LENGTHS + len(symbols) :]
    return True


def _kind(told: int) -> int:
    """Which table is meant by its class and number; -1: none."""
    return (told >> 4) * 4 + (told & 15) if told >> 4 < 2 and told & 15 < 4 else -1


def _fault_of_scan(data: bytes, at: int, segment: bytes, frame: Frame, tables: Tables) -> str:
    """The same of the scan that begins there."""
    count = segment[0] if segment else 0
    if not frame.samplings or count != len(frame.samplings) or len(segment) != 4 + 2 * count:
        return UNCHECKED
    blocks: list[tuple[int, int]] = []
    for one in range(1, 1 + 2 * count, 2):
        across, down = frame.samplings.get(segment[one], (0, 0))
        if count == 1:
            across = down = 1
        first, others = _kind(segment[one + 1] >> 4), _kind(0x10 | segment[one + 1] & 15)
        if across == 0 or not {first, others} <= frame.known:
            return UNCHECKED
        blocks += [(first, others)] * (across * down)
    if len(blocks) > MOST_BLOCKS:
        return UNCHECKED
    most_across, most_down = (max(pair[k] for pair in frame.samplings.values()) for k in (0, 1))
    if count == 1:
        most_across = most_down = 1
    (w, h), wide, high = frame.size, 8 * most_across, 8 * most_down
    units = -(-w // wide) * -(-h // high)
    plan = np.array(blocks, dtype=np.int32)
    image = np.frombuffer(data, np.uint8)
    codes = tables.firsts, tables.counts, tables.places, tables.symbols
    fill_quick(*codes, tables.quick)
    return "" if is_whole(image, at, *codes, tables.quick, plan, units, frame.restart) else TORN


@kernel
def fill_quick(firsts: I32, counts: I32, places: I32, symbols: U8, quick: I32) -> None:
    """Fills `quick` of all kinds, which is zero before; 0 stands for a longer code, or none."""
    for kind in range(KINDS):
        for size in range(1, QUICK_BITS + 1):
            free = QUICK_BITS - size
            for k in range(counts[kind, size]):
                entry = size << 8 | int(symbols[kind, places[kind, size] + k])
                begin = (firsts[kind, size] + k) << free
                for bits in range(begin, begin + (1 << free)):
                    quick[kind, bits] = entry


@kernel
def read_ahead(data: U8, at: int, bits: int, held: int) -> tuple[int, int, int]:
    """More bits of the scan behind those held, until a marker or the end; `at`, bits and held."""
    end = len(data)
    while held <= MOST_HELD and at < end:
        byte = int(data[at])
        if byte == 0xFF:
            if at + 1 >= end or data[at + 1] != 0:
                break
            at += 1
        bits, held, at = bits << 8 | byte, held + 8, at + 1
    return at, bits, held


@kernel
def long_code(bits: int, held: int, firsts: I32, counts: I32, places: I32, symbols: U8) -> int:
    """The code that the bits begin with, if it is no quick one, as `quick` has it; 0: none.

    Args:
        firsts, counts, places, symbols: of one table.
    """
    for size in range(QUICK_BITS + 1, LENGTHS):
        off = (bits << size >> held) - firsts[size]
        if 0 <= off < counts[size]:
            return size << 8 | int(symbols[places[size] + off])
    return 0


@kernel
def is_whole(
    data: U8, at: int, firsts: I32, counts: I32, places: I32, symbols: U8, quick: I32, plan: I32,
    units: int, restart: int,
) -> bool:  # fmt: skip
    """Whether so many units of blocks end where the data do.

    Args:
        data: (n,) the file; its scan begins at `at`.
        plan: (blocks of a unit, 2) kinds of tables.
        restart: units between two restarts, or 0.
    """
    bits, held = 0, 0  # read and not used yet
    end = len(data)
    for unit in range(units):
        if restart > 0 and unit > 0 and unit % restart == 0:
            at, _, held = read_ahead(data, at, bits, held)
            if held >= 8 or at + 1 >= end or not 0xD0 <= data[at + 1] <= 0xD7:
                return False
            at, bits, held = at + 2, 0, 0
        for block in range(len(plan)):
            number = 0  # of those of the block
            while number < 64:
                kind = plan[block, min(number, 1)]
                if held < MOST_HELD:
                    at, bits, held = read_ahead(data, at, bits, held)
                entry = quick[kind, (bits << QUICK_BITS >> held) & ((1 << QUICK_BITS) - 1)]
                if entry == 0:
                    entry = long_code(
                        bits, held, firsts[kind], counts[kind], places[kind], symbols[kind]
                    )
                symbol = entry & 255
                size = symbol if number == 0 else symbol & 15  # of the number itself, in bits
                number += 1 if number == 0 else (64 if symbol == 0 else (symbol >> 4) + 1)
                held -= (entry >> 8) + size
                if entry == 0 or size > 15 or held < 0 or (number > 64 and symbol != 0):
                    return False
                bits &= (1 << held) - 1
    at, _, held = read_ahead(data, at, bits, held)
    while at + 1 < end and data[at] == 0xFF and data[at + 1] == 0xFF:
        at += 1  # filling
    return bool(held < 8 and at + 1 < end and data[at] == 0xFF and data[at + 1] == 0xD9)
