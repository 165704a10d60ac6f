"""Tests of `core/mapping/beams`."""
