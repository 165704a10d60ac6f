"""Method `certainty`: an elevation and a certainty of each cell, to be compared with."""
