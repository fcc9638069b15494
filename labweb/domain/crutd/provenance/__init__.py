"""Where things came from and what became of them: matter, acts, people, devices, code."""
