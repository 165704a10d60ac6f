"""Tests of `core/paths/cleaning`."""
