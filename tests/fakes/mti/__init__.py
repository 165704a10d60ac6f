"""Tests of `fakes/mti`."""
