"""Passes for what a person does, confirms or states during the run."""
