"""Tests of `fakes/faults`."""
