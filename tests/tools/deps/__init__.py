"""Tests of tools.deps."""
