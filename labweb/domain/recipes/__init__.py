"""Recipes, graph formats and advice: everything that becomes a workflow or a plan."""
