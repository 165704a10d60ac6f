"""One frame of a depth camera: floor, walls, objects and the space seen through."""
