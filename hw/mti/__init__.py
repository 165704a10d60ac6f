"""Xsens MTi attitude sensors."""
