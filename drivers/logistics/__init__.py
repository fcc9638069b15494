"""What moves and stores labware."""
