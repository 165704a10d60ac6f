"""The other end of every wire: byte-level devices, the world, the planner. Stands alone."""
