"""How long ago the scanner's mount was measured, as the settings have noted it."""

from datetime import datetime

from tools.calibration.noted import maybe_noted
from tools.doctor.finding import Finding

OLD_DAYS = 180  # a mount that was knocked or screwed meanwhile tells nobody
ADVICE = "On flat floor: `mapod calibrate --height METRES --write`"


def of_calibration(text: str, now: datetime) -> Finding:
    """From the text of the settings."""
    noted = maybe_noted(text)
    if noted is None:
        return Finding("warning", "calibrated", "never, as far as the settings say", ADVICE)
    days = (now - noted).days
    if days < 0:
        says = f"on {noted:%Y-%m-%d}, which is yet to come"
        return Finding("warning", "calibrated", says, "Set the machine's clock")
    says = f"{days} days ago, on {noted:%Y-%m-%d}"
    if days > OLD_DAYS:
        return Finding("warning", "calibrated", says, ADVICE)
    return Finding("OK", "calibrated", says)
