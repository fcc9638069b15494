"""What was measured: samples of device statuses, lossy by contract, and readings, kept for good."""
