"""Runs, jobs and attempts: what may start, what happened, what happens next."""
