"""REST of runs, jobs, approvals and the stop of the lab."""
