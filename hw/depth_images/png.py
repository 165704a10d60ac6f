"""Depth images in PNG: grey, 16 bits a pixel, not interlaced.

Python's own zlib inflates, so no library is needed, and every chunk's checksum is looked at: what
a general library makes of a damaged file may seem whole.
Source: W3C, Portable Network Graphics, sections 5, 9 and 11.
"""

import zlib

import numpy as np

from core.records import U8, U16
from jit import kernel

SIGNATURE = b"\x89PNG\r\n\x1a\n"
GREY, DEPTH = 0, 16
NONE, SUB, UP, MEAN, PAETH = range(5)  # filters of a row
HEAD_BYTES, ZERO = 13, np.int64(0)


class PngError(Exception):
    """Why a file is no such image."""


@kernel
def _unfilter(rows: U8, height: int, width: int, numbers: U16) -> bool:
    """Undo the filters of rows (height, 1 + 2 width) in place; False: one is unknown.

    Args:
        numbers: (height, width) written.
    """
    for i in range(height):
        kind = rows[i, 0]
        if kind > PAETH:
            return False
        for j in range(1, 2 * width + 1):
            left = np.int64(rows[i, j - 2]) if j > 2 else ZERO
            above = np.int64(rows[i - 1, j]) if i > 0 else ZERO
            corner = np.int64(rows[i - 1, j - 2]) if i > 0 and j > 2 else ZERO
            guess = ZERO
            if kind == SUB:
                guess = left
            elif kind == UP:
                guess = above
            elif kind == MEAN:
                guess = (left + above) >> 1
            elif kind == PAETH:
                a, b, c = abs(above - corner), abs(left - corner), abs(left + above - 2 * corner)
                if a <= b and a <= c:
                    guess = left
                elif b <= c:
                    guess = above
                else:
                    guess = corner
            rows[i, j] = (np.int64(rows[i, j]) + guess) & 0xFF
        for j in range(width):
            numbers[i, j] = np.int64(rows[i, 1 + 2 * j]) << 8 | np.int64(rows[i, 2 + 2 * j])
    return True


def _chunks(data: bytes) -> tuple[bytes, bytes]:
    """The head, and all image data. Raises PngError: not whole, or damaged."""
    at, head, packed = len(SIGNATURE), b"", list[bytes]()
    while at + 12 <= len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + size]
        if len(data) < at + 12 + size:
            break
        if (
            zlib.crc32(data[at + 4 : at + 8 + size]).to_bytes(4, "big")
            != data[at + 8 + size : at + 12 + size]
        ):
            raise PngError("a PNG with a wrong checksum")
        if kind == b"IHDR":
            head = body
        elif kind == b"IDAT":
            packed.append(body)
        elif kind == b"IEND":
            return head, b"".join(packed)
        at += 12 + size
    raise PngError("a PNG without its end")


def numbers_of(data: bytes, size_px: tuple[int, int]) -> U16:
    """The image (rows, columns).

    Args:
        size_px: width and height that it must have.

    Raises:
        PngError: it is none, damaged, or of another kind or size.
    """
    if not data.startswith(SIGNATURE):
        raise PngError("an image that is no PNG")
    head, packed = _chunks(data)
    if len(head) != HEAD_BYTES:
        raise PngError("a PNG without a head")
    size = int.from_bytes(head[:4], "big"), int.from_bytes(head[4:8], "big")
    if size != size_px:
        w, h = size_px
        raise PngError(f"an image of {size[0]} x {size[1]} px, its camera has {w} x {h}")
    depth, colour, interlaced = head[8], head[9], head[12]
    if (depth, colour) != (DEPTH, GREY) or any(head[10:12]) or interlaced:
        raise PngError(
            f"a PNG of {depth} bits, colour type {colour}{', interlaced' if interlaced else ''}: "
            f"depths are of {DEPTH} bits, grey (type {GREY}), not interlaced"
        )
    width, height = size
    whole = height * (1 + 2 * width)
    inflate = zlib.decompressobj()
    try:
        raw = inflate.decompress(packed, whole + 1)
    except zlib.error:
        raise PngError("a PNG whose image data is damaged") from None
    if len(raw) != whole:
        raise PngError("a PNG that lacks part of its image, or has too much")
    rows: U8 = np.frombuffer(bytearray(raw), np.uint8).reshape(height, 1 + 2 * width)
    numbers: U16 = np.empty((height, width), np.uint16)
    if not _unfilter(rows, height, width, numbers):
        raise PngError("a PNG with a filter that is unknown")
    numbers.setflags(write=False)
    return numbers


def warm() -> None:
    """Run the kernel once, so that it is not compiled while a robot drives."""
    _unfilter(np.zeros((1, 3), np.uint8), 1, 1, np.zeros((1, 1), np.uint16))
