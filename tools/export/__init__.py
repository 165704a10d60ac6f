"""`mapod export`: a recording as files for others' programs."""
