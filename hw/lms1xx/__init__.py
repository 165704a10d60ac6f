"""SICK LMS1xx laser scanners."""
