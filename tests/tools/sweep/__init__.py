"""Tests of sweeps and of the engine under them."""
