"""What measures on the bench."""
