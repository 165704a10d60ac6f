"""Tests of `core/mapping/heights`."""
