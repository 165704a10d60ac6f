"""What is known of one cell, as a sentence: for the page, the terminal and `mapod why`.

It loads no compiler and no map, so that the page's server may use it.
"""

import math

from core.mapping.causes import CAUSES, OUTSIDE, state_of
from core.records import FREE, OBSTACLE, UNKNOWN

STATES = {OBSTACLE: "obstacle", FREE: "free", UNKNOWN: "unknown"}


def span(seconds: float) -> str:
    """
    >>> span(0.04), span(12.34), span(187.0), span(7300.0)
    ('0.0 s', '12.3 s', '3 min 7 s', '2 h 1 min')
    """
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"


def word_of(cause: int) -> str:
    """A cause in a word, also of a code of later days."""
    return CAUSES[cause].word if cause in CAUSES else f"cause {cause}"


def describe_cell(
    cause: int,
    age_s: float = math.nan,
    height_m: float = math.nan,
    variance_m2: float = math.nan,
) -> str:
    """One cell in words, from what tiles tell of it; NaN is not known.

    >>> describe_cell(64, 0.4, 0.012, 1e-4).split(": ")[0]
    'free (floor)'
    >>> describe_cell(128, 12.0, 0.31)[-29:]
    'Last met or passed 12.0 s ago'
    >>> describe_cell(0)
    'outside of the map'
    """
    if cause == OUTSIDE:
        return "outside of the map"
    sentence = f" {CAUSES[cause].sentence}" if cause in CAUSES else ""
    parts = [f"{STATES[state_of(cause)]} ({word_of(cause)}):{sentence}".rstrip(".")]
    if math.isfinite(height_m):
        spread = f" +- {math.sqrt(variance_m2):.2f} m" if variance_m2 > 0 else ""
        parts.append(f"Height {height_m:.2f} m{spread}")
    if math.isfinite(age_s):
        parts.append(f"Last met or passed {span(age_s)} ago")
    return ". ".join(parts)
