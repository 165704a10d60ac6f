"""What mapod costs."""
