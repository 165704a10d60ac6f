"""What runs on the robot: the standard library alone, for nothing else is there yet."""
