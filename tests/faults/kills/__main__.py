"""`python -m tests.faults.kills --seeds 0..199`: kill processes of an edge host, 50 for each seed.

Each seed's figures are one line of JSON in the record. With `--resume` the seeds that stand
there are not played again, so that a soak may be interrupted.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.faults.kills.play import play

KILLS_OF_A_SEED = 50
ALL_COUNT, ALL_WITHIN_S = 10_000, 3600.0
"""So many kills in so long, on two cores."""


def done_before(record: Path) -> dict[int, dict[str, Any]]:
    """Read the figures that stand in a record; a line that was cut off counts for nothing."""
    found: dict[int, dict[str, Any]] = {}
    if record.exists():
        for line in record.read_text().splitlines():
            try:
                figures = json.loads(line)
            except ValueError:
                continue
            found[figures["seed"]] = figures
    return found


def soak(seeds: range, kills_count: int, record: Path, *, resume: bool) -> list[dict[str, Any]]:
    """Play the seeds, and write each one's figures down as soon as it ends."""
    before = done_before(record) if resume else {}
    record.write_text("".join(json.dumps(one) + "\n" for one in before.values()))
    results = [before[seed] for seed in seeds if seed in before]
    with record.open("a") as stream:
        for seed in seeds:
            if seed in before:
                continue
            with tempfile.TemporaryDirectory(prefix="kl", dir=_memory()) as folder:
                figures = play(Path(folder), seed, kills_count)
            stream.write(json.dumps(figures) + "\n")
            stream.flush()
            results.append(figures)
    return results


def _memory() -> str:
    """Give a folder in memory, where there is one.

    SIGKILL takes nothing back that a process has written, synced or not, so that such a
    folder shows the same; a disk would only be slower.
    """
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else "/tmp"


def summary(results: Sequence[dict[str, Any]]) -> str:
    """Say in one line what all seeds came to."""

    def total(name: str) -> int:
        return sum(int(one[name]) for one in results)

    most = max((one["most_actuations"] for one in results), default=0)
    violations = sum(len(one["violations"]) for one in results)
    each_s = sum(one["seconds"] for one in results) / max(1, total("kills"))
    return (
        f"{len(results)} seeds, {total('kills')} kills, {total('actions')} actions, "
        f"{total('complete')} complete, {total('in_doubt')} in doubt of which "
        f"{total('in_doubt_had_acted')} had acted, {total('events')} events, "
        f"at most {most} actuation of an action, {violations} violations; {each_s:.2f} s a kill: "
        f"{ALL_COUNT} in {ALL_COUNT * each_s / 60:.0f} min (limit {ALL_WITHIN_S / 60:g})"
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults.kills", description=__doc__)
    parser.add_argument("--seeds", default="0..199", help="A..B, both included, or one seed")
    parser.add_argument("--kills", type=int, default=KILLS_OF_A_SEED, help="of each seed")
    parser.add_argument("--record", type=Path, default=Path("kills.jsonl"))
    parser.add_argument("--resume", action="store_true", help="leave out seeds in the record")
    options = parser.parse_args(argv)
    first, _, last = options.seeds.partition("..")
    seeds = range(int(first), int(last or first) + 1)
    results = soak(seeds, options.kills, options.record, resume=options.resume)
    print(summary(results))
    for one in results:
        for text in one["violations"]:
            print(f"  seed {one['seed']}: {text}")
    return 1 if any(one["violations"] for one in results) else 0


if __name__ == "__main__":
    sys.exit(main())
