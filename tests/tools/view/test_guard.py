"""Who may look and drive: hosts, origins, tokens."""

import os
from pathlib import Path

import pytest

from tools.view.guard import Guard, TokenError, token_of

TOKEN = "a token of some length"


@pytest.mark.parametrize(
    ("host", "origin", "may"),
    [
        ("127.0.0.1:8750", None, True),
        ("127.0.0.1:8750", "http://127.0.0.1:8750", True),
        ("LocalHost:8750", "http://localhost:8750", True),
        ("[::1]:8750", "http://[::1]:8750", True),
        ("192.168.0.7:8750", "https://192.168.0.7:8750", True),
        ("127.0.0.1:8750", "http://127.0.0.1:3000", False),
        ("127.0.0.1:8750", "http://localhost:8750", False),
        ("127.0.0.1:8750", "https://evil.example", False),
        ("127.0.0.1:8750", "null", False),
        ("127.0.0.1:8750", "", False),
        ("evil.example:8750", "http://evil.example:8750", False),
        ("evil.example:8750", None, False),
        ("127.0.0.1.evil.example", None, False),
        ("[", "http://[", False),
        ("", "", False),
    ],
)
def test_only_this_machine_is_asked_and_only_by_its_own_page(
    host: str, origin: str | None, may: bool
) -> None:
    assert bool(Guard("127.0.0.1", TOKEN).refusal(host, origin)) is not may


def test_looking_needs_a_token_wherever_others_reach_it() -> None:
    alone = ("127.0.0.1", "127.0.0.9", "::1", "localhost")
    assert not any(Guard(host, TOKEN).looking_needs_token for host in alone)
    reached = ("0.0.0.0", "::", "10.0.0.1", "robot")
    assert all(Guard(host, TOKEN).looking_needs_token for host in reached)


def test_a_token_is_right_or_not() -> None:
    guard = Guard("127.0.0.1", TOKEN)
    assert guard.token_is_right(TOKEN)
    for wrong in ("", TOKEN[:-1], TOKEN + "x", "ä€\ud800"):
        assert not guard.token_is_right(wrong)


def test_a_token_file_is_made_for_its_owner_alone_and_kept(tmp_path: Path) -> None:
    path = tmp_path / "token"
    before = os.umask(0)
    try:
        token = token_of(path)
    finally:
        os.umask(before)
    assert path.stat().st_mode & 0o777 == 0o600
    assert token_of(path) == token
    assert len({token, token_of(None), token_of(None)}) == 3


@pytest.mark.parametrize(
    ("content", "mode", "words"),
    [
        (b"0123456789abcdef", 0o640, "others can read the token; chmod 600"),
        (b"short", 0o600, "16 to 256 letters"),
        (b"0123456789\xff\xfeabcdef", 0o600, "16 to 256 letters"),
        (b"", 0o600, "16 to 256 letters"),
    ],
)
def test_a_token_file_that_cannot_be_used_is_named(
    content: bytes, mode: int, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "token"
    path.write_bytes(content)
    path.chmod(mode)
    with pytest.raises(TokenError, match=words):
        token_of(path)
    with pytest.raises(TokenError, match="No such file"):
        token_of(tmp_path / "nowhere" / "token")
