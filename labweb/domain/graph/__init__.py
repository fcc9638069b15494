"""The physical graph: what can flow or be carried where."""
