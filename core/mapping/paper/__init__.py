"""Method `reference_plane`: the dissertation's chapter 4, to be compared with."""
