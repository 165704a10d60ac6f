"""May it move, and how fast: stop zone, control, health."""
