"""Count what a soak counts, in parts that can be stopped and gone on with.

    python -m tests.counts transfers [--part 1/4] [--record FILE]
    python -m tests.counts invented  [--seed N]
    python -m tests.counts matrix
    python -m tests.counts random    [--seed N]
    python -m tests.counts transfers --report

`transfers`: every ordered pair of vessels at three volumes on every graph of others; `invented`:
200 rigs of a seed; both are answered by `compile_transfers` and judged by `tests/judge`. `matrix`:
every recipe on every rig of the cross-rig matrix. `random`: 5 000 random recipes on random rigs.

Exit code: 0 nothing is wrong, 1 something is.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.counts.record import ROOT, commit, count, report
from tests.counts.units import COUNTS


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.counts")
    parser.add_argument("what", choices=COUNTS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--part", type=_part, default=(1, 1), metavar="I/N")
    parser.add_argument("--record", type=Path, help="default: test-results/counts/WHAT.jsonl")
    parser.add_argument("--report", action="store_true", help="only say what stands in the record")
    options = parser.parse_args(argv)
    record = options.record or ROOT / f"test-results/counts/{options.what}.jsonl"
    state, faults = commit(), 0
    if not options.report:
        faults = count(COUNTS[options.what](options.seed), record, state, options.part)
    print(report(record, state))
    return 1 if faults else 0


def _part(text: str) -> tuple[int, int]:
    first, _, of = text.partition("/")
    if not (first.isdigit() and of.isdigit() and 1 <= int(first) <= int(of)):
        raise argparse.ArgumentTypeError(f"{text!r} is no part: write 1/4 for the first of four")
    return int(first), int(of)


if __name__ == "__main__":
    sys.exit(main())
