"""Tests of `tools/rig/faults`."""
