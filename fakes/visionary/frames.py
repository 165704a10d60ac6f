"""The fake camera's frames on the wire: description, binary segment, message.

Source: visionary sheet, section 5.
"""

import random
import zlib
from datetime import UTC, datetime

from fakes.visionary.faults import Faults
from fakes.visionary.lens import Lens
from fakes.visionary.models import Kind
from fakes.visionary.picture import Maps

TURNED = ((0.8, 0.0, 0.6), (0.0, 1.0, 0.0), (-0.6, 0.0, 0.8))
STRAIGHT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
HEAD_BYTES = 60  # of a message, that damage leaves whole, so that it is the picture which is hit


def description(kind: Kind, lens: Lens, faults: Faults) -> bytes:
    """The XML of the depth set."""
    (w, h), (fx, fy), (cx, cy), (k1, k2) = lens
    if faults.wrong_matrix:
        fx, fy = 10 * fx, 10 * fy
    turn = TURNED if faults.turned_matrix else STRAIGHT
    away = (0.0, 0.0, -kind.away_mm)
    matrix = [value for row, a in zip(turn, away, strict=True) for value in (*row, a)]
    values = "".join(f"<value>{value:.6f}</value>" for value in (*matrix, 0.0, 0.0, 0.0, 1.0))
    name, colour = ("Z" if kind.is_planar else "Distance"), 8 * kind.colour_bytes
    return (
        f'<SickRecord><DataSets><{kind.root} id="1" datacount="1"><DeviceDescription>'
        f"<Ident>{kind.ident} {kind.version}</Ident></DeviceDescription>"
        "<FormatDescriptionDepthMap><TimestampUTC/><Version>uint16</Version><DataStream>"
        f"<Interleaved>false</Interleaved><Width>{w}</Width><Height>{h}</Height>"
        f"<CameraToWorldTransform>{values}</CameraToWorldTransform><CameraMatrix>"
        f"<FX>{fx:.6f}</FX><FY>{fy:.6f}</FY><CX>{cx:.6f}</CX><CY>{cy:.6f}</CY></CameraMatrix>"
        f"<CameraDistortionParams><K1>{k1:.6f}</K1><K2>{k2:.6f}</K2><P1>0.0</P1><P2>0.0</P2>"
        "<K3>0.0</K3></CameraDistortionParams><FrameNumber>uint32</FrameNumber>"
        "<Quality>uint8</Quality><Status>uint8</Status>"
        f'<{name} decimalexponent="{kind.exponent}" min="1" max="65534">uint16</{name}>'
        f'<Intensity decimalexponent="0" min="1" max="20000">uint{colour}</Intensity>'
        '<Confidence decimalexponent="0" min="0" max="65535">uint16</Confidence></DataStream>'
        "</FormatDescriptionDepthMap><DataLink><FileName>data.bin</FileName></DataLink>"
        f"</{kind.root}></DataSets></SickRecord>"
    ).encode("ascii")


def stamp_of(calendar_s: float) -> int:
    """The 64 bits of a time, seconds since 1970."""
    whole_ms = round(1000 * calendar_s)
    at = datetime.fromtimestamp(whole_ms // 1000, UTC)
    fields = ((at.year, 47), (at.month, 43), (at.day, 38), (at.hour, 22), (at.minute, 16))
    return sum(value << shift for value, shift in (*fields, (at.second, 10), (whole_ms % 1000, 0)))


def binary(maps: Maps, kind: Kind, faults: Faults, calendar_s: float, number: int) -> bytes:
    """The depth set: little-endian, with its length twice."""
    grey = maps.colour
    if kind.colour_bytes == 4:  # red, green, blue and a byte that is full
        level = (grey >> 7).astype("<u4")
        colour = (level * 0x010101 | 0xFF000000).astype("<u4").tobytes()
    else:
        colour = grey.astype("<u2").tobytes()
    fields = stamp_of(calendar_s).to_bytes(8, "little") + (2).to_bytes(2, "little")
    fields += number.to_bytes(4, "little") + bytes([97, faults.status & 0xFF])
    depths, third = maps.raw.astype("<u2").tobytes(), maps.third.astype("<u2").tobytes()
    content = b"".join((fields, depths, colour, third))
    length = (len(content) + 8).to_bytes(4, "little")
    crc = zlib.crc32(content) ^ (0xFFFF if faults.wrong_checksum else 0)
    copy = bytes(4) if faults.wrong_length else length
    return b"".join((length, content, crc.to_bytes(4, "little"), copy))


def message(xml: bytes, change: int, depths: bytes, segments: int) -> bytes:
    """A whole BLOB: offsets count from its byte 11."""
    overlay, places = b"<Overlay/>", [28, 28 + len(xml), 28 + len(xml) + len(depths)]
    table = b"".join(at.to_bytes(4, "big") + change.to_bytes(4, "big") for at in places)
    body = b"\x00\x01b\x00\x01" + segments.to_bytes(2, "big") + table
    size = len(body) + len(xml) + len(depths) + len(overlay)
    return b"".join((b"\x02" * 4, size.to_bytes(4, "big"), body, xml, depths, overlay, b"E"))


def damaged(piece: bytes, faults: Faults, chance: random.Random) -> bytes:
    """What its faults leave of a message."""
    if chance.random() < faults.cut_rate:
        return piece[: chance.randrange(HEAD_BYTES, len(piece))]
    if chance.random() < faults.damaged_rate:
        hit = bytearray(piece)
        for _ in range(8):
            hit[chance.randrange(len(piece) // 2, len(piece))] ^= chance.randrange(1, 256)
        return bytes(hit)
    return piece
