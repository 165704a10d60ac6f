"""Playing what was recorded: the same app on the same bytes at the same instants."""
