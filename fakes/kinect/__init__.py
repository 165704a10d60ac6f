"""Fake Kinect: what its sensor makes of a world, as a stream of frames or a dump to be played."""
