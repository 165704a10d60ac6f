"""Tests of `tools/conformance`."""
