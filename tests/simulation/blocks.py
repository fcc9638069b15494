"""Which seeds are played: a few in `make test`, other and many more ones in `make soak SEED=n`."""

from __future__ import annotations

import os


def blocks(in_test: int, in_soak: int, *, blocks_count: int) -> list[range]:
    """Return the seeds in blocks of equal length, one for each test."""
    is_soak = bool(os.environ.get("LABWEB_SOAK"))
    count = in_soak if is_soak else in_test
    first = int(os.environ.get("LABWEB_SEED", "0")) * count if is_soak else 0
    size = count // blocks_count
    return [range(at, at + size) for at in range(first, first + count, size)]
