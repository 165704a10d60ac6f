"""Tests of `core/paths`."""
