"""Which jobs go to which host, when, and whose work waits."""
