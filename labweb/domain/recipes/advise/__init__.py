"""Which changes of a rig a recipe asks for; a person accepts the changed graph, or not."""
