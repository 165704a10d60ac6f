"""What a person runs on the steps from a depth image to objects: frames, pictures."""
