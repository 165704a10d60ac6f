"""Mutants that change nothing that could be seen, by name, each with the reason."""

EQUIVALENT: dict[str, str] = {}
