"""Tests of the fake Visionary cameras."""
