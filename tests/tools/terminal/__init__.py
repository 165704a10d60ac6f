"""Tests of `tools/terminal`."""
