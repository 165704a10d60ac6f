"""Tests of `tools/rig`."""
