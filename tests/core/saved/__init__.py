"""Tests of `core/saved`."""
