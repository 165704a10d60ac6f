"""The vector map that frames correct: objects, walls, doors, and what moves."""
