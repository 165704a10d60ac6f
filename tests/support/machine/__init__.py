"""Of this machine: sockets, terminals, time, users and a second root."""
