"""The journal: what an edge host knows for certain, on disk before it acts."""
