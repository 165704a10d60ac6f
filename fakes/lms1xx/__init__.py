"""Fake SICK LMS1xx."""
