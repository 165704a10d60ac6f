"""Tests of the fake camera with a laser."""
