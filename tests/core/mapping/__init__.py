"""Tests of `core/mapping`."""
