"""Fake Hokuyo URG-04LX and two sisters."""
