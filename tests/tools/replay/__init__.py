"""Tests of `tools.replay`."""
