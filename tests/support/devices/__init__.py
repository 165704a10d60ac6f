"""Single devices: fakes and drivers on wires in memory, scripted ones, frames of their sheets."""
