"""Devices without a wire: computing nodes, encapsulated workstations."""
