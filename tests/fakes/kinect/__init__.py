"""Tests of the fake Kinect."""
