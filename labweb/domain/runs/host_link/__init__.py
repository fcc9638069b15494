"""The link of a host to the server: its session, and its clocks."""
