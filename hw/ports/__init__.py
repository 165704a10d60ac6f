"""Wires by URL that open, lose and reopen without waiting."""
