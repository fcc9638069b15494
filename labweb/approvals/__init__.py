"""Policies, requests and decisions."""
