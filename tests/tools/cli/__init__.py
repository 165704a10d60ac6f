"""Tests of `tools/cli`."""
