"""What tells what a sample is."""
