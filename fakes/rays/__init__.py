"""What a beam meets."""
