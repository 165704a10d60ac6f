"""Tests of `hw/runtime`."""
