"""Tests of `hw/urg04lx`."""
