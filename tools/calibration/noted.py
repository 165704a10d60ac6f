"""When the scanner's mount, or its ranges, were last measured: a comment in the settings."""

import re
from datetime import UTC, datetime

NOTE = re.compile(r"^# calibrated (\S+)[^\n]*\n", re.MULTILINE)  # the mount
RANGES_NOTE = re.compile(r"^# ranges calibrated (\S+)[^\n]*\n", re.MULTILINE)
HEAD = re.compile(r"^[ \t]*\[[ \t]*scanner[ \t]*\][^\n]*\n", re.MULTILINE)
FORM = "%Y-%m-%dT%H:%M:%SZ"


def with_note(text: str, now: datetime) -> str:
    """The settings with a line under `[scanner]` that says so; an older one goes.

    >>> with_note("[scanner]\\nport = 1\\n", datetime(2026, 3, 1, 12, 0, tzinfo=UTC))
    '[scanner]\\n# calibrated 2026-03-01T12:00:00Z by `mapod calibrate`\\nport = 1\\n'
    """
    return _with_line(NOTE.sub("", text), "# calibrated", "mapod calibrate", now)


def with_ranges_note(text: str, now: datetime) -> str:
    """The same of its ranges; that of the mount stays."""
    text = RANGES_NOTE.sub("", text)
    return _with_line(text, "# ranges calibrated", "mapod calibrate range", now)


def _with_line(text: str, what: str, command: str, now: datetime) -> str:
    line = f"{what} {now.astimezone(UTC).strftime(FORM)} by `{command}`"

    def noted(head: re.Match[str]) -> str:
        return head[0] + line + ("\r\n" if head[0].endswith("\r\n") else "\n")

    return HEAD.sub(noted, text, count=1)


def maybe_noted(text: str, note: re.Pattern[str] = NOTE) -> datetime | None:
    """What such a line says (`note`: of what); None: there is none, or no date in it."""
    found = note.search(text)
    try:
        return datetime.strptime(found[1], FORM).replace(tzinfo=UTC) if found else None
    except ValueError:
        return None
