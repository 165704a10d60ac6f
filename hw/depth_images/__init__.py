"""Depth cameras whose images come whole: a Kinect of this machine, and a folder of images."""
