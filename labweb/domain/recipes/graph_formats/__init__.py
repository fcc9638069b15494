"""Physical graphs from one format into another, and what is lost on the way."""
