"""How long the catalog takes to read a tree of source, beside `ast.parse` alone on the same bytes.

Both read each file anew and keep nothing of it, in turns, so that what else the machine does
meets both.
"""

from __future__ import annotations

import ast
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.figures import Figure, report
from drivers.catalog.inspect import PACKAGE
from drivers.catalog.scan import scan

PUBLISHED = PACKAGE.parent / ".cache/third-party"
"""Where `tests/third_party` installs the drivers of others."""

ROUNDS = 5


def main(folder: Path | None = None) -> int:
    """Measure a folder; without one PyLabRobot where it is installed, else the drivers here."""
    return report("inspection", figures(folder or _at_hand()))


def figures(folder: Path) -> Iterator[Figure]:
    """Yield how many files and classes were read, and how long both took."""
    files = sorted(folder.rglob("*.py"))
    found = scan(folder)
    yield Figure(name=f"files below {folder.name}", value=len(files), unit="")
    yield Figure(name="classes inspected", value=len(found.drivers), unit="")
    yield Figure(name="files that cannot be read", value=len(found.findings), unit="", limit=0)
    parse_s, scan_s = [], []
    for _ in range(ROUNDS):
        start = time.process_time()
        for file in files:
            ast.parse(file.read_bytes())
        between = time.process_time()
        scan(folder)
        parse_s.append(between - start)
        scan_s.append(time.process_time() - between)
    yield Figure(name="ast.parse alone, processor time", value=min(parse_s), unit="s")
    yield Figure(name="catalog, processor time", value=min(scan_s), unit="s")
    yield Figure(
        name="catalog, in that of ast.parse", value=min(scan_s) / min(parse_s), unit="", limit=2
    )


def _at_hand() -> Path:
    return next(PUBLISHED.glob("lib/python*/site-packages/pylabrobot"), PACKAGE)
