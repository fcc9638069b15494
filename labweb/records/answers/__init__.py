"""What the endpoints of provenance and reports answer with."""
