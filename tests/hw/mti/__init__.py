"""Tests of `hw/mti`."""
