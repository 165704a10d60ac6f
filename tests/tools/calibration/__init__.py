"""Tests of `tools/calibration`."""
