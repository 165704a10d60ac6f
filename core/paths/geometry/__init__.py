"""Where a machine's centre may be, and the shortest ways there."""
