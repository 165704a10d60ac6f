"""The register tables of docs/protocols/modbus.md, made from the code.

The text of the document is written by hand; what stands between its marks is written by this tool.
"""

import re
import sys
from pathlib import Path

from hw.modbus import client, image, layout, network, status
from hw.modbus.drive import REFUSED, RESULTS
from hw.modbus.layout import Block, Refusal
from hw.modbus.server import units_of

DOCUMENT = Path(__file__).resolve().parents[2] / "docs/protocols/modbus.md"
SHIPPED_CELLS = 101  # the window that the table of the window block shows
MARKS = re.compile(r"<!-- begin (\w+) -->\n.*?<!-- end \1 -->", re.DOTALL)
KINDS = {"ascii": "text", "cells": "cells"}
MEANINGS = {
    Refusal.FUNCTION: "unknown function; or a drive request from another machine",
    Refusal.ADDRESS: "there is no such register, or it can't be written",
    Refusal.VALUE: "a count or a value out of its range; part of a drive request",
    Refusal.BUSY: "the frozen window of this unit is too old, or the map was not trusted since: "
    "freeze it anew",
    Refusal.NO_UNIT: "no such unit (TCP and UDP; on a serial line: silence)",
}


def rows(block: Block) -> list[str]:
    lines = ["| register | name | type | unit | meaning |", "| --- | --- | --- | --- | --- |"]
    for entry in block.entries:
        last = entry.address + entry.registers - 1
        where = f"{entry.address}" if last == entry.address else f"{entry.address}-{last}"
        kind = KINDS.get(entry.kind, entry.kind)
        lines.append(f"| {where} | `{entry.name}` | {kind} | {entry.unit} | {entry.meaning} |")
    return lines


def sizes() -> list[str]:
    lines = [
        "| N | S | registers of the cells | last register of the block | reads of 125 |",
        "| --- | --- | --- | --- | --- |",
    ]
    for cells in (21, 101, 201, 401):
        block = layout.window_block(cells)
        stride = layout.stride_of(cells)
        reads = -(-block.size // layout.MOST_READ)
        end = block.first + block.size - 1
        lines.append(f"| {cells} | {stride} | {cells * stride} | {end} | {reads} |")
    return lines


def limits() -> list[str]:
    return [
        "| what | how much |",
        "| --- | --- |",
        f"| registers a read | {layout.MOST_READ} |",
        f"| requests per second of one client, for long | {client.CLIENT_HZ:g} |",
        f"| at once, after a rest | {client.CLIENT_BURST:g} |",
        f"| requests per second of all clients of all ports | {image.ALL_HZ:g} |",
        f"| requests of one client that wait; more end the connection | {client.MOST_WAITING} |",
        f"| TCP connections | {network.MOST_CONNECTIONS} |",
        f"| a TCP connection without a request is closed after | {network.IDLE_S:g} s |",
        f"| or, when another wants its place, after | {network.SPARED_S:g} s |",
        f"| new maps a second, at most | {1 / image.PACK_S:g} |",
        f"| a frozen window can be read for | {image.VIEW_S:g} s |",
        f"| nothing is told as true any more after mapod's silence of | {status.STALE_S:g} s |",
    ]


def units() -> list[str]:
    """Unit ids for `unit = 1`."""
    lines = ["| port | live registers | frozen views |", "| --- | --- | --- |"]
    for kind, name in (("tcp", "TCP and UDP"), ("serial", "serial (RTU)")):
        live, frozen = units_of(1, kind)
        ids = f"{frozen[0]} to {frozen[-1]}" if len(frozen) > 1 else f"{frozen[0]}"
        lines.append(f"| {name} | {', '.join(map(str, live))} | {ids} |")
    return lines


def refusals() -> list[str]:
    lines = ["| exception | meaning |", "| --- | --- |"]
    return lines + [f"| {code:02X}h | {words} |" for code, words in MEANINGS.items()]


def results() -> list[str]:
    lines = ["| `ack_result` | meaning |", "| --- | --- |", "| 0 | taken |"]
    lines.append(f"| {REFUSED} | refused for another reason: mapod's log says which |")
    return lines + [f"| {code} | {words} |" for words, code in RESULTS.items()]


SECTIONS = {
    "status": lambda: rows(layout.STATUS_BLOCK),
    "latch": lambda: rows(layout.LATCH_BLOCK),
    "coarse": lambda: rows(layout.COARSE_BLOCK),
    "drive": lambda: rows(layout.DRIVE_BLOCK),
    "window": lambda: rows(layout.window_block(SHIPPED_CELLS)),
    "sizes": sizes,
    "limits": limits,
    "units": units,
    "refusals": refusals,
    "results": results,
}


def filled(text: str) -> str:
    def section(found: re.Match[str]) -> str:
        name = found[1]
        table = "\n".join(SECTIONS[name]())
        return f"<!-- begin {name} -->\n{table}\n<!-- end {name} -->"

    return MARKS.sub(section, text)


def main() -> int:
    DOCUMENT.write_text(filled(DOCUMENT.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
