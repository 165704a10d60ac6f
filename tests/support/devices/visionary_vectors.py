"""The frames and telegrams of tests/vectors/visionary, and small frames for sessions."""

import csv
from typing import NamedTuple

from tests import VECTORS

ROOM = VECTORS / "visionary"
T_MINI, S = ((ROOM / f"{name}_4x3.blob").read_bytes() for name in ("tmini", "s"))


class Telegram(NamedTuple):
    """One line of control.tsv."""

    is_cola_2: bool
    is_hosts: bool
    data: bytes
    meaning: str


def _telegrams() -> list[Telegram]:
    with open(ROOM / "control.tsv", encoding="ascii", newline="") as file:
        return [
            Telegram(
                row["protocol"] == "cola_2",
                row["from"] == ">",
                bytes.fromhex(row["bytes"]),
                row["meaning"],
            )
            for row in csv.DictReader(file, delimiter="\t")
        ]


TELEGRAMS = _telegrams()
