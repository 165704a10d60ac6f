"""Heights of a map of method `surface`, for who asks: layers, and ground for feet."""
