"""Drivers: one class per instrument model, read as text by the catalog, run on edge hosts."""
