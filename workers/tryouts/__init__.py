"""Drivers that their author tries on a simulated instrument of this host; see docs/edge.md."""
