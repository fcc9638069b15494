"""The rules of the laboratory: pure functions over frozen data, no framework and no I/O."""
