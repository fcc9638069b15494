"""An edge host: accepts signed work, carries it out at most once, and tells what happened."""
