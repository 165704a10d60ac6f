"""Section 13's frames as bytes, for the tests of conformance."""

import json

from tests import ROOT

PATH = ROOT / "tests/vectors" / "planner_link.json"


def _read() -> dict[str, bytes]:
    table: dict[str, str] = json.loads(PATH.read_text(encoding="utf-8"))
    named = {name: text for name, text in table.items() if not name.startswith(("origin", "auth"))}
    return {name: bytes.fromhex(text) for name, text in named.items() if "0x" not in text}


VECTORS = _read()
