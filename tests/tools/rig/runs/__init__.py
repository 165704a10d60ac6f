"""Tests of `tools/rig/runs`."""
