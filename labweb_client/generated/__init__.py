"""Made from the schema of the interface."""
