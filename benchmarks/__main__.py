"""`python -m benchmarks [NAME]`: measure one thing, or all, and print it beside its limits.

Exit code 1 when a limit is broken. The sizes of the limits are the defaults; smaller ones
show only that a benchmark works.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from importlib import import_module
from pathlib import Path

from benchmarks import clicks, inspection, plans, registration, start, steps, transfers
from benchmarks.database import an_empty_database
from benchmarks.figures import Options, report

WITH_DATABASE = {
    "transfer": "liquid transfers beside a bare transaction; --size transfers of each kind",
    "tree": "subtree, ancestors, find by id, move; --size resources",
    "import": "labs from files; --size nodes of the large one",
    "telemetry": "samples from 1000 statuses at 10 Hz to storage and browser; --size seconds",
    "lineage": "a sample 50 transfers deep; --size events",
}
WITHOUT = {
    "start": ("how long `make run` takes", start.main),
    "steps": ("what a step costs beside a plain Celery loop", lambda: steps.main([])),
    "clicks": ("from a click to the first motion", lambda: clicks.main([])),
    "registration": (
        "from a driver's source to its first service on a device",
        lambda: registration.main([]),
    ),
    "inspection": ("drivers read as text beside ast.parse alone", inspection.main),
    "plans": ("a workflow planned and proved beside bare shortest paths", plans.main),
    "routes": ("compiled transfers beside a bare shortest path", transfers.speed),
}
FIGURES = Path(__file__).parents[1] / "docs" / "figures"
NAMES = (*WITHOUT, *WITH_DATABASE)


def main() -> int:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=". ".join(
            f"{name}: {text}"
            for name, text in ({n: t for n, (t, _) in WITHOUT.items()} | WITH_DATABASE).items()
        )
        + ".",
    )
    parser.add_argument("name", nargs="?", choices=NAMES, help="which; all without it")
    parser.add_argument("--size", type=_count, help="how many, in place of the limit's number")
    parser.add_argument(
        "--record", action="store_true", help="keep what comes out in docs/figures/NAME.txt"
    )
    parser.add_argument("--graph", type=Path, help="for import: a graph of Uni-Lab-OS")
    options = parser.parse_args()
    if options.name is None and not options.record:
        return max([_alone(name, options.graph) for name in NAMES])
    if options.record and options.name not in WITH_DATABASE:
        parser.error(f"--record goes with one of {', '.join(WITH_DATABASE)}")
    if options.name in WITHOUT:
        return WITHOUT[options.name][1]()
    with an_empty_database():
        # What it imports is there only after Django has been set up.
        module = import_module(f"benchmarks.{options.name}_")
        wanted = Options(size=options.size, graph=options.graph)
        record = FIGURES / f"{options.name}.txt" if options.record else None
        return report(options.name, module.figures(wanted), record)


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no number above zero")
    return int(text)


def _alone(name: str, graph: Path | None) -> int:
    """Run one in a process of its own, so that none finds the memory of another."""
    given = [] if graph is None else ["--graph", str(graph)]
    command = [sys.executable, "-m", "benchmarks", name, *given]
    return subprocess.run(command, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
