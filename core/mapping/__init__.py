"""Scans to maps: rays, the mapper, what can be asked of a map."""
