"""Tests of `hw/visionary`."""
