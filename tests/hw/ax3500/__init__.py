"""Tests of `hw/ax3500`."""
