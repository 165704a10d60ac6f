"""Why the robot stood, and why a cell was what it was: a recording, asked about one moment."""
