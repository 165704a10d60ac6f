"""Whole robots: the app as shipped, on a simulated clock or as a process, and who moves it."""
