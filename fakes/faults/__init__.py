"""Faults by name and by timetable."""
