"""Tests of `fakes/urg04lx`."""
