"""Tests of `fakes/wires`."""
