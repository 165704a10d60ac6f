"""Real processes against a real clock: the bench, its settings, load, what they tell."""
