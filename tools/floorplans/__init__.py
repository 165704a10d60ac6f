"""Floor plans as files, plans for them, pictures, and planners to compare with."""
