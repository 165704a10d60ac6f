"""Tests of `core/grid`."""
