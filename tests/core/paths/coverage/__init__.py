"""Tests of `core/paths/coverage`."""
