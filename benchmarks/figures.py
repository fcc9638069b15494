"""What a benchmark says: figures beside their limits, and the machine they were taken on."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What may be chosen on the command line."""

    size: int | None = None
    """How many; None is the number of the limit."""

    graph: Path | None = None
    """A published graph to import; None: none is at hand."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One number; without a limit it is there to be compared with."""

    name: str
    value: float
    unit: str
    limit: float | None = None
    is_floor: bool = False
    """The limit is the least that will do, and not the most."""

    @property
    def is_kept(self) -> bool:
        """Tell whether the limit holds."""
        if self.limit is None:
            return True
        return self.value >= self.limit if self.is_floor else self.value <= self.limit

    def render(self) -> str:
        """Return one line of the report."""
        line = f"  {self.name:<58}{_short(self.value):>10} {self.unit:<5}"
        if self.limit is None:
            return line.rstrip()
        sign = "≥" if self.is_floor else "≤"
        verdict = "" if self.is_kept else "   BROKEN"
        return f"{line} {sign} {_short(self.limit)} {self.unit}{verdict}".rstrip()


def _short(value: float) -> str:
    if value == int(value) or value >= 1000:
        return f"{value:,.0f}".replace(",", " ")
    return f"{value:.2f}" if value < 100 else f"{value:.0f}"


def report(name: str, figures: Iterable[Figure], record: Path | None = None) -> int:
    """Print figures as they come, and keep them in a file; return 1 when a limit is broken."""
    lines, broken = [f"{name}   {machine()}"], 0
    sys.stdout.write(f"{lines[0]}\n")
    for figure in figures:
        lines.append(figure.render())
        sys.stdout.write(f"{lines[-1]}\n")
        sys.stdout.flush()
        broken += not figure.is_kept
    load = f"{os.getloadavg()[0]:.1f}; a million additions of Python take {python_ms():.0f} ms"
    lines.append(f"  load of the machine at the end: {load}")
    sys.stdout.write(f"{lines[-1]}\n")
    if record is not None:
        record.parent.mkdir(parents=True, exist_ok=True)
        record.write_text("\n".join([*_origin(), "", *lines, ""]), encoding="utf-8")
    return 1 if broken else 0


def _origin() -> list[str]:
    """Say of which commit a record is, when it was taken, and how to take it again."""
    root = Path(__file__).parents[1]
    commit = _git(root, "rev-parse", "HEAD") or "unknown"
    changed = " with uncommitted changes" if _git(root, "status", "--porcelain") else ""
    command = " ".join(["python -m benchmarks", *sys.argv[1:]])
    at = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    return [f"commit   {commit}{changed}", f"date     {at}", f"command  {command}"]


def _git(root: Path, *words: str) -> str:
    done = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=False)
    return done.stdout.strip()


def machine() -> str:
    """Name the machine, and how busy others kept it in the last minute."""
    memory = Path("/proc/meminfo").read_text(encoding="ascii").split()[1]
    return (
        f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, "
        f"{int(memory) / 2**20:.0f} GiB, Python {platform.python_version()}, "
        f"load {os.getloadavg()[0]:.1f}"
    )


def fsync_ms(folder: Path, count: int = 50) -> float:
    """Return the median time of writing 200 bytes and an fsync, ms."""
    path = folder / "fsync"
    with path.open("wb", buffering=0) as stream:

        def write() -> None:
            stream.write(b"x" * 200)
            os.fsync(stream.fileno())

        took_ms = [1e3 * timed(write) for _ in range(count)]
    path.unlink()
    return median(took_ms)


def python_ms(count: int = 200_000, times: int = 9) -> float:
    """Return how long a million additions take, ms: what a virtual machine gives comes and goes."""

    def add() -> None:
        total = 0
        for number in range(count):
            total += number

    return 1e9 / count * median(timed(add) for _ in range(times))


def timed(act: Callable[[], object]) -> float:
    """Return how long an act takes, s."""
    begun_s = time.perf_counter()
    act()
    return time.perf_counter() - begun_s


def p95_ms(times_s: Sequence[float]) -> float:
    """Return what 95 of a hundred times do not exceed, ms."""
    ordered = sorted(times_s)
    return ordered[max(0, -(-len(ordered) * 95 // 100) - 1)] * 1e3
