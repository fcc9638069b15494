"""`python -m benchmarks`: run every benchmark and print its figures beside their limits."""

from __future__ import annotations

import sys

from benchmarks import start

if __name__ == "__main__":
    sys.exit(start.main())
