"""Where the scanner sits on the robot."""
