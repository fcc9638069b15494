"""What people decide about jobs in doubt or undone, and what follows."""
