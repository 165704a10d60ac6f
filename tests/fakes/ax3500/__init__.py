"""Tests of `fakes/ax3500`."""
