"""Tests of `fakes/lms1xx`."""
