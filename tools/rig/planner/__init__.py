"""The planner in C: compiled, and run on this machine or on an emulated Cortex-M3."""
