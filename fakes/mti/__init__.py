"""Fake Xsens MTi."""
