"""What the endpoints of the composed server answer with."""
