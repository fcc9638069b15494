"""The processes of an edge host, and the supervisor that starts and watches them."""
