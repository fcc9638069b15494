"""Whether a workflow does what the plan of the same recipe was proved to do."""
