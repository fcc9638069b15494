"""The plan of a workflow as the proof reads it: its claims, its jobs, its lab."""
