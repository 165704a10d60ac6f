"""Where the body was at an instant: attitude, heading, place."""
