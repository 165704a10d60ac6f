"""What a depth camera sees: floor, walls and objects of one frame, and the map of them."""
