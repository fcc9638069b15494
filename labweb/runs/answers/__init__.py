"""What the endpoints of runs, jobs, requests and provenance answer with."""
