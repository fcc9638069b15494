"""Makes the Python client from the schema of the interface."""
