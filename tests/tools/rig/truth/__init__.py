"""Tests of `tools/rig/truth`."""
