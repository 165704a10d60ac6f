"""Tests of `tools/compare`."""
