"""Tests of `hw/depth_images`."""
