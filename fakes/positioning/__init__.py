"""A positioning system that sees the robot from outside, at the far end of the planner link."""
