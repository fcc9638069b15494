"""What becomes of a run when a job of it failed or is in doubt."""
