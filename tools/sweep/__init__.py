"""Many jobs on many cores: recordings by settings, or runs of a campaign; rows as they come."""
