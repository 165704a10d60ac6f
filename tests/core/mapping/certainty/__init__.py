"""Tests of `core/mapping/certainty`."""
