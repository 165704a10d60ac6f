"""How bytes travel between a fake and a host, and what goes wrong on the way."""
