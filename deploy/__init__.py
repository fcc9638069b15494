"""Ways to run labweb: the embedded default, and what production needs."""
