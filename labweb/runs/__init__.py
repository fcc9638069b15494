"""Executions: runs, jobs, attempts, dispatch and what hosts report."""
