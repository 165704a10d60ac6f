"""Tests of `tools/fuzz`."""
