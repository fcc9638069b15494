"""What every app needs; no tables of its own."""
