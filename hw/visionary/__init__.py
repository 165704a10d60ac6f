"""SICK Visionary depth cameras: control by CoLa-2 or CoLa-B, frames on a second port."""
