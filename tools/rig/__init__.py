"""The rig: the whole robot simulated, driven by its planner in C, judged by the truth."""
