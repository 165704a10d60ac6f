"""Tests of `fakes/rays`."""
