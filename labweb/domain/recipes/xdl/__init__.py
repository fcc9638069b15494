"""XDL, the chemical description language: read, checked, written, unfolded."""
