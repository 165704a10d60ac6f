"""Sweeping a floor that nobody knows, beside the loop."""
