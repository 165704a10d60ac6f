"""Tests of `hw/lms1xx`."""
