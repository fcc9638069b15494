"""A count in units that can be done in parts, stopped and gone on with.

Each unit is one line of JSON in the record, written as soon as it is done. A unit that stands there
for the same commit is not done again; one that was found at fault stands there with what was found.
"""

from __future__ import annotations

import json
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Unit:
    """One piece of a count."""

    name: str
    count: Callable[[], Mapping[str, int]]
    """Do it and return its counts; an AssertionError is a fault."""


def commit() -> str:
    """Name the state of the code: the commit, and whether something in it is changed."""
    head = _git("rev-parse", "HEAD")
    return head + ("" if not _git("status", "--porcelain", "--untracked-files=no") else "+")


def _git(*words: str) -> str:
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def rows(record: Path, state: str) -> dict[str, dict[str, Any]]:
    """Return what stands in a record for a state of the code, by unit; half a line is no line."""
    found: dict[str, dict[str, Any]] = {}
    for line in record.read_text("utf-8").splitlines() if record.exists() else ():
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        if row["commit"] == state:
            found[row["unit"]] = row
    return found


def count(units: Iterable[Unit], record: Path, state: str, part: tuple[int, int]) -> int:
    """Do what is missing of one part, of all units every so manieth. Return how many faults."""
    done = rows(record, state)
    first, step = part
    record.parent.mkdir(parents=True, exist_ok=True)
    _begin_a_line(record)
    for unit in list(units)[first - 1 :: step]:
        if unit.name not in done:
            row = {"commit": state, "unit": unit.name} | _done(unit)
            done[unit.name] = row
            with record.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row, ensure_ascii=False) + "\n")
    return sum("fault" in row for row in done.values())


def _begin_a_line(record: Path) -> None:
    text = record.read_text("utf-8") if record.exists() else ""
    if text and not text.endswith("\n"):
        record.write_text(text + "\n", "utf-8")


def _done(unit: Unit) -> dict[str, Any]:
    began = time.process_time()
    try:
        counted: dict[str, Any] = {"counts": dict(unit.count())}
    except AssertionError as error:
        counted = {"counts": {}, "fault": str(error)[:4000]}
    return counted | {"processor_s": round(time.process_time() - began, 1)}


def report(record: Path, state: str) -> str:
    """Say what was counted on a state of the code."""
    found = rows(record, state)
    counts: Counter[str] = Counter()
    for row in found.values():
        counts.update(row["counts"])
    faults = [f"{name}: {row['fault']}" for name, row in found.items() if "fault" in row]
    lines = [f"commit {state}", f"{len(found):7} units, {len(faults)} at fault"]
    lines += [f"{number:7} {what}" for what, number in sorted(counts.items())]
    return "\n".join(lines + faults)
