"""Tests of `fakes/programs`."""
