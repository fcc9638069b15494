"""Samples of device statuses: lossy by contract, never a fact."""
