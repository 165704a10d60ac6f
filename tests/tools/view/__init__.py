"""Tests of `tools/view`."""
