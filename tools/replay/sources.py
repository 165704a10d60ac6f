"""What can be replayed: a recording, a capture of a scanner's traffic, a scanner's bytes alone."""

from pathlib import Path
from typing import Protocol

from config_file import load_config
from core.config import Config, ConfigError
from recording.reader import Recording
from recording.records import RecordingError
from tools.replay.capture import MARKS, Capture, CaptureError
from tools.replay.changes import changed
from tools.replay.heard import HeardReplay
from tools.replay.instants import Timeline
from tools.replay.outcome import Replay, differences
from tools.replay.player import Player
from tools.replay.span import timeline_of
from tools.replay.streams import chosen, describe_end, stream_of

SIGNED = "its frames are signed: without --key-file they can't be compared, nor requests obeyed"


def drive_in(path: Path) -> Recording:
    """A recording of mapod. Raises RecordingError: it is none; OSError."""
    if path.is_file():
        with path.open("rb") as file:
            if file.read(4) in MARKS:
                raise RecordingError(
                    f"{path} is a capture of a scanner's network traffic, which tells of no drive: "
                    "only mapod replay plays it"
                )
    return Recording(path)


class Source(Protocol):
    """A replay, and what is known about where it comes from."""

    timeline: Timeline
    name: str

    @property
    def replay(self) -> Replay: ...

    @property
    def is_as_recorded(self) -> bool:
        """False: what went to the planners was judged, and is another thing."""

    def about(self) -> list[str]:
        """What it is; before it is played."""

    def verdict(self) -> list[str]:
        """What is to be said about how it was played; at the end."""


class OfRecording:
    """A recording of mapod.

    Args:
        other: the text of other settings.
        values: single ones, `section.key=value`.
        key: of the planner link.

    Raises:
        RecordingError, ConfigError, OSError.
    """

    def __init__(
        self, path: Path, other: str | None, values: list[str], key: bytes | None, version: str
    ) -> None:
        self.name, self._version = path.name, version
        self.recording = recording = Recording(path)
        try:
            recorded = load_config(recording.config)
        except ConfigError as error:
            raise RecordingError(
                f"{path}: recorded by mapod {recording.version}, whose settings are not those of "
                f"mapod {version}: {error}"
            ) from None
        config = changed(load_config(other) if other is not None else recorded, values)
        self._key, self._is_signed = key, recording.metadata.get("has_key") == "true"
        self._is_what_if = config != recorded
        self.replay = self._player = Player(recording, config, key=key)
        self.timeline = timeline_of(recording, self._player.begin_s)

    @property
    def _is_judged(self) -> bool:
        is_open = not self._is_signed or self._key is not None
        return is_open and self.recording.from_start and not self._is_what_if

    @property
    def is_as_recorded(self) -> bool:
        return not self._is_judged or all(check.is_identical for check in self._player.checks)

    def about(self) -> list[str]:
        recording, line = self.recording, self.timeline
        began = line.utc(line.begin_s).strftime("%Y-%m-%d %H:%M:%S")
        seconds = line.end_s - line.begin_s
        files = f", {len(recording.parts)} files" if len(recording.parts) > 1 else ""
        lines = [
            f"{self.name}: {seconds:.1f} s from {began} UTC on, mapod {recording.version}{files}"
        ]
        if message := recording.metadata.get("message"):
            lines.append(f"saved because: {message}")
        return lines

    def verdict(self) -> list[str]:
        lines, recording = list(self._player.remarks), self.recording
        if self._player.done and recording.is_cut:
            lines.append("the recording was cut off: it was played up to what is whole of it")
        if recording.gap:
            lines.append(f"{recording.gap}: it was played up to there")
        if self._is_what_if:
            lines += self._what_if()
        elif self._is_judged:
            lines += self._judged()
        elif self._is_signed and self._key is None:
            lines.append(SIGNED)
        return lines

    def _judged(self) -> list[str]:
        lines = []
        for check in self._player.checks:
            lines.append(check.describe())
            if check.first is not None:
                t_s = check.first.t_s
                since_s = t_s - self.timeline.begin_s
                lines[-1] += f", at {self.timeline.clock(t_s)} UTC ({since_s:.3f} s)"
        if not self.is_as_recorded and self.recording.version != self._version:
            lines.append(
                f"it was recorded by mapod {self.recording.version} and played by {self._version}: "
                "another version may tell something else"
            )
        return lines

    def _what_if(self) -> list[str]:
        """Against the same stretch with the recorded settings."""
        assert self._player.lead is not None
        found = differences(self._player, self._player.lead)
        lines = [f"with these settings: {line}" for line in found]
        return [*lines, "other settings than recorded: what the planner got is not compared"]


class OfCapture:
    """A scanner's bytes out of network traffic. Raises CaptureError, OSError."""

    is_as_recorded = True

    def __init__(self, path: Path, config: Config, stream: int | None) -> None:
        self.name, self._capture = path.name, Capture(path)
        self._conversation = chosen(self._capture, stream)
        end = self._conversation.scanner
        if end is None:
            raise CaptureError(
                f"{path}: stream {self._conversation.describe()}: neither end is a scanner"
            )
        self._scanner = self._conversation.ends[end]
        self._stream = stream_of(self._capture, self._conversation, end)
        pieces = self._stream.pieces
        self.replay = replay = HeardReplay(pieces, config)
        offset_s = pieces[0][0] - replay.begin_s if pieces else 0.0
        self.timeline = Timeline(replay.begin_s, replay.end_s, offset_s)

    def about(self) -> list[str]:
        pieces, spec = self._stream.pieces, self.replay.config.scanner.options.spec
        count = sum(len(piece) for _, piece in pieces)
        return [
            f"{self.name}: stream {self._conversation.number}, {count} bytes of the scanner "
            f"{describe_end(self._scanner)}, {1 / spec.period_s:g} Hz; the robot is level and "
            "stands still"
        ]

    def verdict(self) -> list[str]:
        lines = []
        if self._capture.is_cut:
            lines.append("the capture was cut off: it was played up to its last whole packet")
        if self._stream.missing:
            lines.append(f"{self._stream.missing} bytes of the scanner were not captured")
        return lines


class OfScanner:
    """What a scanner alone has sent: a device that is asked. Needs the simulation."""

    is_as_recorded = True

    def __init__(self, path: Path, config: Config) -> None:
        from tools.replay.laser import LONGEST_START_S, LaserReplay

        self.name = path.name
        self.replay = replay = LaserReplay(path, config)
        self.timeline = Timeline(replay.begin_s, replay.begin_s + LONGEST_START_S, 0.0)

    def about(self) -> list[str]:
        return [f"{self.name}: {self.replay.recording.scans} scans; the robot is level and stands"]

    def verdict(self) -> list[str]:
        return []
