"""Fake Roboteq AX3500."""
