"""REST of hosts, devices, drivers and tries of drivers."""
