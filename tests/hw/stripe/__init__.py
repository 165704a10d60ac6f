"""Tests of `hw/stripe`."""
