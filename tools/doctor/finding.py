"""One line of what the doctor says: how bad, about what, what it is, and what to do."""

from dataclasses import dataclass
from typing import Literal

Level = Literal["OK", "warning", "fault"]
STATUS: dict[Level, int] = {"OK": 0, "warning": 1, "fault": 2}


@dataclass(frozen=True, slots=True)
class Finding:
    """A warning: mapod runs, but something is missing or slow. A fault: it can't run at all."""

    level: Level
    about: str
    says: str
    advice: str = ""

    def __str__(self) -> str:
        advice = f". {self.advice}" if self.advice else ""
        return f"{self.level:<8} {self.about:<10} {self.says}{advice}"


def status_of(findings: list[Finding]) -> int:
    """The exit status: 0 all fine, 1 warnings, 2 a fault."""
    return max((STATUS[finding.level] for finding in findings), default=0)
