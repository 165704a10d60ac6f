"""Tests of `fakes/world`."""
