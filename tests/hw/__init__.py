"""Tests of `hw`."""
