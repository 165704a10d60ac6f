"""The fakes as programs of their own."""
