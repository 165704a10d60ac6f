"""Tests of `tools/experiments`."""
