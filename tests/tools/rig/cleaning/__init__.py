"""Tests of `tools/rig/cleaning`."""
