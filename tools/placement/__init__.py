"""Where to mount a sensor that looks down: what it sees of rough ground, and how well."""
