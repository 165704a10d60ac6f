"""What can go wrong on the wires and in the devices, and a drive while it does."""
