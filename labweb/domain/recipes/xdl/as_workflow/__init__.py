"""A recipe as a workflow of labweb, step by step."""
