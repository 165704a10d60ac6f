"""How long ago the scanner's mount and ranges were measured, as the settings have noted it."""

from datetime import datetime

from core.device_settings import Scanner
from tools.calibration.noted import RANGES_NOTE, maybe_noted
from tools.doctor.finding import Finding

OLD_DAYS = 180  # a mount that was knocked or screwed meanwhile tells nobody
ADVICE = "On flat floor: `mapod calibrate --height METRES --write`"
RANGES_ADVICE = (
    "With a board at six distances or more: `mapod calibrate range --at METRES ... --write`"
)


def of_calibration(text: str, now: datetime) -> Finding:
    """Of the mount, from the text of the settings."""
    noted = maybe_noted(text)
    if noted is None:
        return Finding("warning", "calibrated", "never, as far as the settings say", ADVICE)
    return _aged("calibrated", noted, now, ADVICE)


def maybe_of_ranges(text: str, now: datetime, scanner: Scanner) -> Finding | None:
    """Of the ranges; None: the scanner's driver corrects none."""
    correction = getattr(scanner.options, "correction", None)
    if correction is None:
        return None
    noted = maybe_noted(text, RANGES_NOTE)
    if noted is not None and any(correction):
        return _aged("ranges", noted, now, RANGES_ADVICE)
    if noted is not None:
        says = (
            f"calibrated on {noted:%Y-%m-%d}, but scanner.correction is 0: they are not corrected"
        )
    elif any(correction):
        says = "corrected, but the settings don't say when that was calibrated"
    else:
        says = "never calibrated: they are not corrected"
    return Finding("warning", "ranges", says, RANGES_ADVICE)


def _aged(about: str, noted: datetime, now: datetime, advice: str) -> Finding:
    days = (now - noted).days
    if days < 0:
        says = f"on {noted:%Y-%m-%d}, which is yet to come"
        return Finding("warning", about, says, "Set the machine's clock")
    says = f"{days} days ago, on {noted:%Y-%m-%d}"
    if days > OLD_DAYS:
        return Finding("warning", about, says, advice)
    return Finding("OK", about, says)
