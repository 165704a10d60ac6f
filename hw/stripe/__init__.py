"""Structured light: a camera and the plane of a laser, from images to sweeps."""
