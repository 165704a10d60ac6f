"""An audit tells weaknesses, and never takes a list that says nothing for good news."""

from pathlib import Path
from typing import Any

import pytest

from tests import Capsys, Patch
from tools.deps import audit
from tools.deps.audit import CLEAN, UNKNOWN, WEAK, audit_from_report

GOOD: dict[str, Any] = {"name": "numpy", "version": "2.1", "vulns": []}
WEAKNESS = {"id": "PYSEC-1", "aliases": ["CVE-2"], "fix_versions": ["3.14.6"]}
BAD: dict[str, Any] = {"name": "aiohttp", "version": "3.14.5", "vulns": [WEAKNESS]}
SKIPPED = {"name": "cobs", "skip_reason": "not found"}


@pytest.mark.parametrize(
    ("found", "status", "words"),
    [
        ([GOOD], CLEAN, "1 of 1 libraries"),
        ([GOOD, BAD, SKIPPED], WEAK, "aiohttp 3.14.5: PYSEC-1, CVE-2; mended in 3.14.6"),
        ([GOOD, SKIPPED], UNKNOWN, "the list did not tell of cobs"),
        ([SKIPPED], UNKNOWN, "nothing is known"),
        ([], UNKNOWN, "nothing is known"),
    ],
)
def test_what_a_list_says_is_told(found: list[Any], status: int, words: str) -> None:
    told = audit_from_report({"dependencies": found})
    assert told.status == status
    assert words in "\n".join(told.lines())


def test_where_nothing_can_be_asked_it_says_so(
    tmp_path: Path, capsys: Capsys, monkeypatch: Patch
) -> None:
    """A folder without the tool stands for a machine without a network."""
    package = tmp_path / "pip_audit"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "__main__.py").write_text("raise SystemExit('no route to host')")
    monkeypatch.setattr("sys.argv", ["audit", "--tool", str(tmp_path)])
    assert audit.main() == UNKNOWN
    assert "nothing was looked at: no route to host" in capsys.readouterr().out
