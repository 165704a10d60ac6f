"""A hall that a simulated machine maps and cleans, and what that was worth."""
