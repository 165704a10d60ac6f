"""What is true: robot, terrain, people, and the errors of sensors."""
