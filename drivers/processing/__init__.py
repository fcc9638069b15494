"""What changes material: heating, stirring, evaporation."""
