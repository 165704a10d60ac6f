"""Roboteq AX3500 motor controllers with encoders."""
