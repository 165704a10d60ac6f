"""Centimetre terrain maps of a walking robot: the same scans through several methods, measured."""
