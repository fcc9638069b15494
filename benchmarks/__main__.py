"""`python -m benchmarks`: run every benchmark and print its figures beside their limits."""

from __future__ import annotations

import sys

from benchmarks import start, transfers

if __name__ == "__main__":
    sys.exit(max(start.main(), transfers.speed()))
