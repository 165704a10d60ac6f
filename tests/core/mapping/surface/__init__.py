"""Tests of `core/mapping/surface`, and of its paper."""
