"""Fake web camera that sees the line of a laser, and serves MJPEG over HTTP."""
