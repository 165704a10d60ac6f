"""Scenes: files, and what they leave to chance."""
