"""Maps: worlds in closed formulas, cells laid by hand, and methods once more, slow and obvious."""
