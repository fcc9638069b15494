"""What a driver's process may reach, and how the kernel holds it to that."""
