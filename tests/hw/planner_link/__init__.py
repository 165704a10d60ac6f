"""Tests of `hw/planner_link`."""
