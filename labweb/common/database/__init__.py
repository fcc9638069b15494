"""Queries and sessions: what is asked of PostgreSQL often, together or in bulk."""
