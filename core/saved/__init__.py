"""A map's state as bytes, and a map that goes on from them."""
