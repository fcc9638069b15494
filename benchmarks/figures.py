"""A measured figure beside its limit, and the machine it was measured on."""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured value."""

    name: str
    value: float
    limit: float | None
    """None: a peer, measured for comparison alone."""

    unit: str

    @property
    def is_kept(self) -> bool:
        """Say whether the value is within its limit."""
        return self.limit is None or self.value <= self.limit


def show(figures: Sequence[Figure]) -> int:
    """Print each figure beside its limit; 1 when one is beyond."""
    for one in figures:
        limit = "" if one.limit is None else f"limit {one.limit:g}"
        mark = "" if one.is_kept else "   BEYOND"
        sys.stdout.write(f"{one.name:<48}{one.value:10.2f} {one.unit:<10} {limit}{mark}\n")
    return 0 if all(one.is_kept for one in figures) else 1


def machine(folder: Path) -> str:
    """Say on what was measured: cores, how busy they are, and what an fsync costs there."""
    load = os.getloadavg()[0]
    return (
        f"{platform.machine()}, {os.cpu_count()} cores, load {load:.1f}, "
        f"fsync {fsync_ms(folder):.2f} ms"
    )


def fsync_ms(folder: Path, count: int = 50) -> float:
    """Return the median time of writing 200 bytes and an fsync, ms."""
    path = folder / "fsync"
    took_ms = []
    with path.open("wb", buffering=0) as stream:
        for _ in range(count):
            began_s = time.perf_counter()
            stream.write(b"x" * 200)
            os.fsync(stream.fileno())
            took_ms.append((time.perf_counter() - began_s) * 1000)
    path.unlink()
    return median(took_ms)
