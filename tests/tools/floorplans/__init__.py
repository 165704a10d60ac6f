"""Tests of `tools/floorplans`."""
