"""Tests of `tools/rig/real_time`."""
