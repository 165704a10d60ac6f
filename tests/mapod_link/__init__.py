"""Tests of `mapod_link`."""
