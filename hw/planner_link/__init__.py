"""The planner link: maps out, requests in."""
