"""Instants within a recording, as a person names them: seconds from its begin, or UTC."""

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

FORMS = "seconds from the begin, HH:MM:SS or 2026-03-01T12:03:05 (UTC)"
TIME_OF_DAY = re.compile(r"([01]?\d|2[0-3]):([0-5]\d):([0-5]\d(?:\.\d+)?)Z?")
SLACK_S = 1.0  # a whole second that was cut off from either end is meant to be inside


class InstantError(Exception):
    """No instant of the recording; the text says what was given and what is allowed."""


@dataclass(frozen=True, slots=True)
class Timeline:
    """From when to when a recording goes."""

    begin_s: float  # host clock
    end_s: float
    utc_offset_s: float  # UTC less host clock

    def utc(self, t_s: float) -> datetime:
        return datetime.fromtimestamp(t_s + self.utc_offset_s, UTC)

    def clock(self, t_s: float) -> str:
        """`12:03:05.250`"""
        return self.utc(t_s).strftime("%H:%M:%S.%f")[:-3]

    def instant(self, option: str, text: str) -> float:
        """Host clock of what a person has named. Raises InstantError."""
        t_s = self._maybe_instant(text.strip())
        if t_s is None:
            raise InstantError(f"{option}: must be {FORMS}, is {text!r}")
        if t_s < self.begin_s and text.strip().startswith("-"):
            raise InstantError(f"{option}: must be 0 s from the begin or more, is {text}")
        if not self.begin_s - SLACK_S <= t_s <= self.end_s + SLACK_S:
            span = f"{self.clock(self.begin_s)} to {self.clock(self.end_s)} UTC"
            length_s = self.end_s - self.begin_s
            raise InstantError(
                f"{option}: {text} is not within the recording, which is {length_s:.1f} s: {span}"
            )
        return t_s

    def _maybe_instant(self, text: str) -> float | None:
        try:
            return self.begin_s + float(text)
        except ValueError:
            pass
        begin = self.utc(self.begin_s)
        try:
            if found := TIME_OF_DAY.fullmatch(text):
                hours, minutes, seconds = int(found[1]), int(found[2]), float(found[3])
                midnight = begin.replace(hour=0, minute=0, second=0, microsecond=0)
                at = midnight + timedelta(hours=hours, minutes=minutes, seconds=seconds)
                if at < begin - timedelta(seconds=SLACK_S):
                    at += timedelta(days=1)
            else:
                at = datetime.fromisoformat(text)
                at = at.replace(tzinfo=UTC) if at.tzinfo is None else at
        except ValueError:
            return None
        return at.timestamp() - self.utc_offset_s
