"""The passes from a recipe to the plan of one physical graph, each a file of its own."""
