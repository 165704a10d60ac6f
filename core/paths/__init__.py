"""Paths over polygons: coverage of a floor, and ways from A to B."""
