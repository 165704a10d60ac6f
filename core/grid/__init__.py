"""Storage without meaning: cells that follow the robot."""
