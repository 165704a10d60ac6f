"""Method `surface`: a map of the ground and of what stands on it, by one model of terrain."""
