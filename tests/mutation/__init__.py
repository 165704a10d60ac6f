"""Whether the tests of what moves the robot, and of what is told as free, would see a fault."""
