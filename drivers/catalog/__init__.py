"""Reads driver source as text. Nothing here imports a driver or runs a line of one."""
