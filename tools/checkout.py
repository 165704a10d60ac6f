"""Which state of the sources this checkout is."""

import subprocess

from tools.cli.options import ROOT


def commit() -> str:
    """As git describes it, with + where there are changes; "" where it is no checkout."""
    command = ["git", "describe", "--always", "--dirty=+", "--exclude=*"]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip()
