"""Tests of what brings mapod onto a robot, and runs it there."""
