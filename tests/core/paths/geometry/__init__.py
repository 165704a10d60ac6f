"""Tests of `core/paths/geometry`."""
