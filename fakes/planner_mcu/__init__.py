"""The planner's end of the link: a demonstration."""
