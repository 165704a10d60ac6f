"""Tests of `fakes/planner_mcu`."""
