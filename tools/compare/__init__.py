"""A real device and its fake, asked the same."""
