"""`python -m benchmarks`: run every benchmark and print its figures beside their limits."""

from __future__ import annotations

import sys

from benchmarks import clicks, start, steps

if __name__ == "__main__":
    results = [start.main(), clicks.main([]), steps.main([])]
    sys.exit(max(results))
