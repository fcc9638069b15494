"""What joins vessels: pumps and valves."""
