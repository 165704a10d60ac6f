"""Tests of `hw/ports`."""
