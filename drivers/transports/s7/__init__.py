"""S7 controllers: data blocks that are read and written by their bytes."""
