"""A recording is read as it was written, up to where it is cut, or refused in one line."""

import contextlib
import struct
import tracemalloc
from pathlib import Path

import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from recording.mcap_stream import (
    CHANNEL,
    CHUNK,
    CHUNK_HEAD,
    MAGIC,
    MESSAGE,
    MESSAGE_HEAD,
    MOST_BYTES,
    MOST_NAME,
    RECORD,
    SCHEMA,
    McapStream,
)
from recording.mcap_stream import METADATA as OF_METADATA
from recording.reader import Recording, first_metadata
from recording.records import CHECK, HEALTH, LOGS, METADATA, Record, RecordingError, with_check
from tests.support.robot.recorded import RecordedLoop
from tests.support.robot.shipped import shipped


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[Record], Path]:
    """A file of three seconds, its records, and room for another."""
    path = tmp_path_factory.mktemp("read") / "whole.mcap"
    loop = RecordedLoop(path, shipped())
    loop.run(3.2)
    loop.recorder.close()
    recording = Recording(path)
    records = list(recording.records())
    assert not recording.is_cut
    return path.read_bytes(), records, path.with_name("other.mcap")


def read(path: Path, data: bytes) -> tuple[list[Record], str, bool]:
    """What can be read, why no more, and whether the file is cut."""
    path.write_bytes(data)
    found: list[Record] = []
    try:
        recording = Recording(path)
        found.extend(recording.records())
        list(recording.logs())
    except RecordingError as error:
        return found, str(error), False
    return found, "", recording.is_cut


@given(at=st.floats(0.0, 1.0, exclude_max=True))
def test_a_file_that_is_cut_is_read_up_to_there(
    made: tuple[bytes, list[Record], Path], at: float
) -> None:
    data, records, path = made
    found, error, is_cut = read(path, data[: int(at * len(data))])
    assert len(error.splitlines()) <= 1
    assert found == records[: len(found)]
    assert error or is_cut or found == records
    if at > 0.5:  # half of these three seconds: they are on the disk second by second
        assert not error
        assert found[-1].t_s - records[0].t_s > 0.9


@given(at=st.floats(0.0, 1.0, exclude_max=True), bits=st.integers(1, 255))
def test_a_damaged_byte_is_refused_or_makes_no_difference(
    made: tuple[bytes, list[Record], Path], at: float, bits: int
) -> None:
    data, records, path = made
    place = int(at * len(data))
    found, error, is_cut = read(
        path, data[:place] + bytes([data[place] ^ bits]) + data[place + 1 :]
    )
    assert len(error.splitlines()) <= 1
    assert found == records[: len(found)]
    assert error or found == records or is_cut


@given(st.lists(st.binary(max_size=40), max_size=5))
def test_no_bytes_give_anything_but_a_refusal(
    made: tuple[bytes, list[Record], Path], pieces: list[bytes]
) -> None:
    data, records, path = made
    for begin in (b"", MAGIC, data[:60], data[: len(data) // 2]):
        found, error, _ = read(path, begin + b"".join(pieces))
        assert len(error.splitlines()) <= 1
        assert found == records[: len(found)]


def test_what_is_not_of_mapod_is_said_so(tmp_path: Path) -> None:
    for data, words in (
        (b"", "not an MCAP file"),
        (b"pcap", "not an MCAP file"),
        (MAGIC, "not a recording of mapod"),
        (b'{"mapod_recording": 2, "version"', "form 2, not 3"),
    ):
        (tmp_path / "x.mcap").write_bytes(data)
        with pytest.raises(RecordingError, match=words):
            Recording(tmp_path / "x.mcap")
    (tmp_path / "x.mcap").unlink()
    with pytest.raises(RecordingError, match="0 recordings"):
        Recording(tmp_path)


def test_a_record_that_says_more_than_its_chunk_holds_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "short.mcap"
    inside = RECORD.pack(MESSAGE, MESSAGE_HEAD.size + 9) + bytes(MESSAGE_HEAD.size + 8)
    chunk = CHUNK_HEAD.pack(0, 0, len(inside), 0) + bytes(4) + len(inside).to_bytes(8, "little")
    path.write_bytes(MAGIC + RECORD.pack(CHUNK, len(chunk + inside)) + chunk + inside)
    with pytest.raises(RecordingError, match=f"{path} is damaged before byte"):
        list(McapStream(path).records())


def packed_chunk(inside: bytes) -> bytes:
    """A chunk record that zstd has made small."""
    packed = zstandard.ZstdCompressor().compress(inside)
    head = CHUNK_HEAD.pack(0, 0, len(inside), 0) + b"\4\0\0\0zstd"
    chunk = head + len(packed).to_bytes(8, "little") + packed
    return RECORD.pack(CHUNK, len(chunk)) + chunk


@pytest.mark.slow
def test_a_small_file_of_millions_of_empty_records_costs_no_more_memory_than_its_chunk(
    tmp_path: Path,
) -> None:
    path, inside = tmp_path / "bomb.mcap", RECORD.pack(SCHEMA, 0) * 1_000_000
    path.write_bytes(MAGIC + packed_chunk(inside))
    assert path.stat().st_size < len(inside) / 1000
    tracemalloc.start()
    try:
        assert sum(1 for _ in McapStream(path).records()) == 1_000_000
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 3 * len(inside)


def test_a_chunk_that_unpacks_to_more_than_it_says_or_than_is_let_pass_is_refused(
    tmp_path: Path,
) -> None:
    path, honest = tmp_path / "bomb.mcap", packed_chunk(bytes(9 * 1000))
    at = RECORD.size + 16
    for size in (1, MOST_BYTES + 1, 2**63):
        path.write_bytes(MAGIC + honest[:at] + size.to_bytes(8, "little") + honest[at + 8 :])
        with pytest.raises(RecordingError, match="is damaged before byte"):
            list(McapStream(path).records())


def test_channels_of_endless_names_are_refused_for_all_channels_are_kept(tmp_path: Path) -> None:
    path, name = tmp_path / "names.mcap", b"x" * (MOST_NAME + 1)
    channel = bytes(4) + len(name).to_bytes(4, "little") + name + bytes(8)
    path.write_bytes(MAGIC + packed_chunk(RECORD.pack(CHANNEL, len(channel)) + channel))
    with pytest.raises(RecordingError, match="is damaged before byte"):
        list(McapStream(path).records())


def text(words: str) -> bytes:
    return struct.pack("<I", len(words.encode())) + words.encode()


def metadata_record(entries: dict[str, str]) -> bytes:
    body = b"".join(text(part) for entry in entries.items() for part in entry)
    content = text(METADATA) + struct.pack("<I", len(body)) + body
    return RECORD.pack(OF_METADATA, len(content)) + content


def one_message(topic: str, value: str) -> bytes:
    channel = bytes(4) + text(topic) + text("json") + bytes(4)
    message = MESSAGE_HEAD.pack(0, 1, 0, 0) + value.encode()
    channels = RECORD.pack(CHANNEL, len(channel)) + channel
    return channels + RECORD.pack(MESSAGE, len(message)) + message


DEEP, LONG = "[" * 100_000, "1" * 5000
HOSTILE = [
    "", "null", "-1", "[]", "{}", "[[]]", "[null]", '[{"datagrams": 1}]', "NaN", "1e999", DEEP,
    '{"of": {"t_s": "x", "level": 1, "event": [], "keys": 3}}', '{"x_m": [], "t_s": 1}',
    LONG, f'{{"x_m": {LONG}, "t_s": 1}}', "9" * 20, "\xff",
]  # fmt: skip


@pytest.mark.parametrize("value", HOSTILE, ids=lambda value: value[:12])
def test_what_a_hostile_file_says_of_its_run_is_read_or_refused_and_nothing_else(
    made: tuple[bytes, list[Record], Path], value: str
) -> None:
    """With right sums: whoever makes such a file works them out."""
    data, _, path = made
    path.write_bytes(data)
    about = {key: told for key, told in first_metadata(path).items() if key != CHECK}
    for key in (*about, None):
        entries = with_check(about | ({key: value} if key else {}))
        for topic in (LOGS, HEALTH):
            path.write_bytes(MAGIC + metadata_record(entries) + one_message(topic, value))
            for part in ("records", "opening", "logs", "places", "loaded_map"):
                with contextlib.suppress(RecordingError):
                    found = getattr(Recording(path), part)
                    list(found() if callable(found) else found or b"")


def test_nothing_that_steers_a_terminal_comes_out_of_a_file(
    made: tuple[bytes, list[Record], Path],
) -> None:
    data, _, path = made
    path.write_bytes(data)
    about = {key: told for key, told in first_metadata(path).items() if key != CHECK}
    about |= {"version": "1\x1b[2J", "message": "a\nb\x9b"}
    path.write_bytes(MAGIC + metadata_record(with_check(about)))
    assert Recording(path).version == "1 [2J"
    assert Recording(path).metadata["message"] == "a b "
