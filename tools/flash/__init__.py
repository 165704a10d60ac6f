"""From a checkout to a robot: the bundle, the way over ssh, and what runs there."""
