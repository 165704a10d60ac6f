"""The frames and texts printed in the LMS111's sheet, by their names there."""

import struct

from tests import VECTORS


def _rows(file: str) -> dict[str, str]:
    lines = (VECTORS / file).read_text(encoding="utf-8").splitlines()
    return {row.split("\t")[1]: row.split("\t")[2] for row in lines if not row.startswith("#")}


FRAMES = {name: bytes.fromhex(frame) for name, frame in _rows("lms111_frames.tsv").items()}
TEXTS = {name: text.encode() for name, text in _rows("lms111_texts.tsv").items()}


def framed(head: str | bytes, values: bytes = b"") -> bytes:
    """A telegram of CoLa-B, by the rule of section 2."""
    payload = (head.encode() if isinstance(head, str) else head) + values
    check = 0
    for byte in payload:
        check ^= byte
    return b"\x02" * 4 + struct.pack(">I", len(payload)) + payload + bytes([check])


def texted(text: str | bytes) -> bytes:
    return b"\x02" + (text.encode() if isinstance(text, str) else text) + b"\x03"
