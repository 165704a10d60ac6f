"""Numbers: records, geometry, odometry, grids, maps. No I/O, no clock, no log."""
