"""Bytes: ports, protocol codecs without I/O, device sessions, the planner link."""
