"""Tests of `hw/modbus`."""
