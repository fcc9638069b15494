"""How a machine becomes a host, what it is to the server, and the devices that it finds."""
