"""Whole labs as files: labweb's own, Uni-Lab-OS graphs, bindings and simulated benches."""
