"""Tests of `fakes/scenes`."""
