"""Tests of `tools.export`."""
