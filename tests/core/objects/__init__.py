"""Tests of `core/objects`."""
