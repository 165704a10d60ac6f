"""Ratios are taken of works side by side, kept without times, and fail only far beyond noise."""

import json
from pathlib import Path
from typing import Any

from tests import Capsys, Patch
from tools.bench import ratios
from tools.bench.bench import VECTORS
from tools.bench.history import kept_entries
from tools.bench.pairs import Pair, numpy_telegrams, plain_lines
from tools.bench.ratio_picture import place_px
from tools.bench.ratios import FILE, limit_of, main, ratio_of, worse


def test_rounds_are_compared_side_by_side_so_that_a_slow_minute_meets_both() -> None:
    asked: list[str] = []

    def took(name: str, seconds: float) -> Any:
        def work(k: int) -> float:
            asked.append(f"{name}{k}")
            return seconds * (1 + 9 * (k > 4))  # the machine gets busy

        return work

    pair = Pair("ours", "other", took("a", 3.0), took("b", 2.0), 8)
    assert ratio_of(pair, lambda work, k: work(k)) == 1.5
    assert asked[:6] == ["a0", "b0", "a1", "b1", "b2", "a2"]


def test_worse_is_told_and_only_far_beyond_what_was_seen_fails() -> None:
    kept = {"calm": [1.0, 0.98, 1.02], "restless": [1.0, 0.7, 1.4], "gone": [1.0, 1.0, 1.0]}
    for ratio, calm, restless in ((1.1, "", ""), (1.3, "told", "told"), (1.7, "fails", "told"),
                                  (4.1, "fails", "fails")):  # fmt: skip
        new = {"calm": [ratio, 1, 1], "restless": [ratio, 1, 1], "new": [99.0, 1, 1]}
        warned, failed = worse(kept, new)
        for name, expected in (("calm", calm), ("restless", restless)):
            assert any(words.startswith(name) for words in warned) == (expected == "told")
            assert any(words.startswith(name) for words in failed) == (expected == "fails")
        assert not any(words.startswith(("new", "gone")) for words in warned + failed)


def test_a_run_is_kept_with_ratios_alone_and_a_worse_one_fails(
    tmp_path: Path, monkeypatch: Patch, capsys: Capsys
) -> None:
    path, picture, seen = tmp_path / "kept.jsonl", tmp_path / "kept.png", [1.0]
    monkeypatch.setattr(ratios, "measured", lambda passes: {"a / b": [seen[0], 0.9, 1.1]})
    assert main(["--keep"], path, picture) == 0
    assert picture.stat().st_size > 0
    [entry] = kept_entries(path)
    assert set(entry) == {"date", "commit", "machine", "ratios"}
    assert entry["ratios"] == {"a / b": [1.0, 0.9, 1.1]}
    seen[0] = 1.3
    assert main(["--check"], path, picture) == 0
    assert "worse: a / b: 1.3" in capsys.readouterr().out
    seen[0] = 3.0
    assert main(["--check"], path, picture) == 1
    assert main([], path, picture) == 0
    assert len(path.read_text(encoding="utf-8").splitlines()) == 1


def test_others_read_the_same_as_ours() -> None:
    session = (VECTORS / "lms111_session_d2h.bin").read_bytes()
    telegrams = session[session.index(b"sSN LMDscandata") - 8 :]
    size = 9 + int.from_bytes(telegrams[4:8], "big")
    assert numpy_telegrams(telegrams[:size] * 3) == 3
    assert plain_lines(b"?Q0\r10\r?Q1\rFFFFFFFF\r") == 16 + 0xFFFFFFFF


def test_what_is_kept_can_be_drawn_and_held_against() -> None:
    for line in FILE.read_text(encoding="utf-8").splitlines():
        for figure in json.loads(line)["ratios"].values():
            middle, least, most = figure
            assert 0.0 < least <= middle <= most
            assert limit_of(figure) >= 1.6 * middle
            assert place_px(least) <= place_px(most)
