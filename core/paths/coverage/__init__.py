"""A path that sweeps a known floor."""
