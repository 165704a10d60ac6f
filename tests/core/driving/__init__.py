"""Tests of `core/driving`."""
