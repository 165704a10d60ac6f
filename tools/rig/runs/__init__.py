"""The whole robot on a simulated clock: the loop, a run to goals, its record, its picture."""
