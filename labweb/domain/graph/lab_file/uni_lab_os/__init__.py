"""Lab graphs of Uni-Lab-OS: read whole or refused whole, written back without a loss."""
