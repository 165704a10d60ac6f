"""No depth camera: driver "none" of [depth]."""
