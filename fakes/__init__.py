"""The other end of every wire: byte-level devices, the world, the planner. Imports nothing of hw or core."""
