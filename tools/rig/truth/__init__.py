"""What is true in the simulated world, and what a robot did by it. It knows nothing of the app."""
