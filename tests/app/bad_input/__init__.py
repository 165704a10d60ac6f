"""Tables of bad input and of what mapod says to it; `tests/app/test_bad_input.py` tries each row.

settings.tsv: a key of the shipped settings, what is given for it, what is said behind its name.
commands.tsv: a command line of `mapod`, and what its one line says. In the folder where it runs
are the shipped `mapod.toml`, `latin.toml` (not UTF-8), `text.mcap`, `empty.mcap` and `folder`.
`files` has whole files, `frames` what arrives on wires.
"""

from pathlib import Path

HERE = Path(__file__).parent


def rows_of(name: str) -> list[list[str]]:
    """The rows of a table beside this file, without its head."""
    lines = (HERE / name).read_text(encoding="utf-8").splitlines()
    return [line.split("\t") for line in lines[1:]]
