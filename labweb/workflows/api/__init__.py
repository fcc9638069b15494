"""The endpoints of workflows and recipes."""
