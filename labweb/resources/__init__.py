"""Labs, the resource tree, the physical graph, materials and lots."""
