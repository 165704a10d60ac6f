"""Recordings: what a run was given and what it said, in one MCAP file."""
