"""What a run would do here and now, its proof, its start, and the rest planned again."""
