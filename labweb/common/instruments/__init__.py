"""Readers of instrument files. They run in a process of their own and know no Django."""
