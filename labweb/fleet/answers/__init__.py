"""What hosts, devices, drivers and tries answer with."""
