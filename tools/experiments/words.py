"""What docs/experiments.md says before its figures."""

INTRODUCTION = """\
# The experiments

`make experiments` rebuilds the experiments of the paper (P. Gomes, "LADAR Based Mapping and
Obstacle Detection System for Service Robots", 2010, chapter 5) in the simulated world, and goes on
where the paper stopped. It writes this page and the pictures; `make experiments ONLY=5.3` runs one
and prints its figures.

One robot drives in a simulated place. Its devices' bytes go to several instances of the app at the
same instants, which differ in `map.method` and `map.cell_value` only: `reference_plane` is the
paper's method to the letter, `beams` is ours, `beams, kalman` is ours with filtered cells. The
body moves on order, without physics, so that what is measured is the maps; sensors have the noise
of their sheets. All is seeded: the figures come out the same again, but those marked `~`, which are
times on the machine that ran them.

What is measured, always in the window that the planner gets, held against the world:

- *False obstacle cells*: told as obstacle although nothing of 0.10 m or more rises or falls in the
  cell, in the eight around it, or in those next to them. Floor is what a wheel reaches without such
  a step; so a ramp is floor.
- *Obstacle cells missed*: cells of which half or more is 0.15 m or more above or below the floor,
  in which three beams or more truly ended, one of them as much above or below the floor, and which
  are not told as obstacle, nor is one of the eight around.
- *Free on an obstacle*: cells told as free of which half or more is 0.15 m or more above or below
  the floor. The worst that a map can say.
- *Holes, empty cells*: floor cells that beams met, without a height, while there are cells with one
  within two cells on all four sides.
- *Position error of walls*: from each obstacle cell to the nearest true one, centre to centre.

The paper's column has its figures where it gives any. The last column but one says whether beams
is better than reference_plane, the same (within 2 %, times within 25 %), or worse.
"""
