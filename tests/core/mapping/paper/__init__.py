"""Tests of `core/mapping/paper`."""
