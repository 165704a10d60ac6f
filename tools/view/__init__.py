"""The live page of `mapod view`: a receiver of the planner link that serves browsers."""
