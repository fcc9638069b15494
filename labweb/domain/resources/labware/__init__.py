"""Labware: what others' definitions say of it, where its wells lie, and the rows it becomes."""
