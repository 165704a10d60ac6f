"""Tests of `hw/mcu`."""
