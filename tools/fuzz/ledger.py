"""How much each target has been given so far: docs/fuzz.json, and the table of docs/security.md.

Counted are inputs that were run to their end, and their bytes, each time that they were given; not
what a target makes of them. Inputs by chance alone (`--streams`) are counted apart.
"""

import json
import mmap
import struct
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "docs" / "fuzz.json"
DOCUMENT = ROOT / "docs" / "security.md"
HEADING = "| target | inputs | bytes | of them streams | seconds |"
COUNTS = struct.Struct("<QQ")  # inputs, bytes
GUIDED, STREAMS = "guided", "streams"
Ledger = dict[str, dict[str, dict[str, float]]]  # target, way: inputs, bytes, seconds


@dataclass(slots=True)
class Tally:
    """Counts in a file, which outlive a process that ends in the middle of an input."""

    inputs: int = 0
    bytes: int = 0
    _shared: mmap.mmap | None = None

    @classmethod
    def at(cls, path: Path) -> "Tally":
        path.write_bytes(bytes(COUNTS.size))
        with path.open("r+b") as file:
            return cls(_shared=mmap.mmap(file.fileno(), COUNTS.size))

    def add(self, size: int) -> None:
        self.inputs += 1
        self.bytes += size
        if self._shared is not None:
            COUNTS.pack_into(self._shared, 0, self.inputs, self.bytes)


def counted(path: Path) -> tuple[int, int]:
    """Inputs and bytes of a tally's file."""
    inputs, given = COUNTS.unpack(path.read_bytes())
    return inputs, given


def read(path: Path = FILE) -> Ledger:
    if not path.exists():
        return {}
    ledger: Ledger = json.loads(path.read_text(encoding="utf-8"))
    return ledger


def note(target: str, way: str, inputs: int, given: int, seconds: float, path: Path = FILE) -> None:
    """Add a run to what is kept."""
    ledger = read(path)
    kept = ledger.setdefault(target, {}).setdefault(way, {"inputs": 0, "bytes": 0, "seconds": 0})
    kept["inputs"] += inputs
    kept["bytes"] += given
    kept["seconds"] = round(kept["seconds"] + seconds)
    path.write_text(json.dumps(ledger, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def spaced(number: float) -> str:
    """A whole number with a space between thousands."""
    return f"{number:,.0f}".replace(",", " ")


def table(ledger: Ledger, words: dict[str, str]) -> str:
    """As Markdown; `words`: of each target, in the order of its rows. The last row is the sum."""
    rows = [HEADING, "|---|---|---|---|---|"]
    sums = [0.0, 0.0, 0.0, 0.0]
    for name, what in words.items():
        ways = ledger.get(name, {})
        both = [sum(kept[key] for kept in ways.values()) for key in ("inputs", "bytes", "seconds")]
        told = [both[0], both[1], ways.get(STREAMS, {}).get("bytes", 0.0), both[2]]
        sums = [before + one for before, one in zip(sums, told, strict=True)]
        rows.append(f"| {what} | " + " | ".join(map(spaced, told)) + " |")
    return "\n".join([*rows, "| all | " + " | ".join(map(spaced, sums)) + " |"])


def renewed(text: str, new: str) -> str:
    """A document with this table in the place of its older form."""
    begin = text.index(HEADING)
    return text[:begin] + new + text[text.index("\n\n", begin) :]


def write_table(words: dict[str, str]) -> None:
    """Into the document."""
    text = DOCUMENT.read_text(encoding="utf-8")
    DOCUMENT.write_text(renewed(text, table(read(), words)), encoding="utf-8")
