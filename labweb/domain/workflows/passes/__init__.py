"""The compiler's passes: each takes frozen data and returns jobs or findings."""
