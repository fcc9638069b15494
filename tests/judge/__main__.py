"""Judge a compiler of liquid transfers on one graph.

    python -m tests.judge GRAPH REQUESTS.jsonl ANSWERS.jsonl [--tubes]
    python -m tests.judge GRAPH --pairs > REQUESTS.jsonl
    python -m tests.judge GRAPH REQUESTS.jsonl --oracle
    python -m tests.judge GRAPH REQUESTS.jsonl --witness > ANSWERS.jsonl
    python -m tests.judge --invent SEED FOLDER

Exit code: 0 nothing is wrong, 1 something is.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.judge.harness import Line, judge_all, pairs, parse_lines
from tests.judge.invent import invent
from tests.judge.oracle import Oracle
from tests.judge.reading import read_rig
from tests.judge.request import NoRequestError, parse_request
from tests.judge.witness import answer_plainly


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.judge")
    parser.add_argument("graph", type=Path, help="graph file; with --invent, a folder to write to")
    parser.add_argument("requests", nargs="?", type=Path)
    parser.add_argument("answers", nargs="?", type=Path)
    parser.add_argument("--tubes", action="store_true", help="one-way edges carry both ways")
    parser.add_argument("--pairs", action="store_true", help="print every pair as a request")
    parser.add_argument("--oracle", action="store_true", help="print what is feasible")
    parser.add_argument("--witness", action="store_true", help="print a plain answer to each line")
    parser.add_argument("--invent", type=int, metavar="SEED", help="write a rig and requests")
    options = parser.parse_args(argv)
    if options.invent is not None:
        invented = invent(options.invent)
        graph = invented.write(options.graph)
        asked = [json.dumps(line, ensure_ascii=False) + "\n" for line in invented.lines]
        graph.with_suffix(".jsonl").write_text("".join(asked), "utf-8")
        print(graph)
        return 0
    rig = read_rig(options.graph, are_tubes=options.tubes)
    if options.pairs:
        for line in pairs(rig):
            print(json.dumps(line, ensure_ascii=False))
        return 0
    lines = _requests(options.requests)
    if options.oracle:
        _print_oracle(Oracle(rig), lines)
        return 0
    if options.witness:
        oracle = Oracle(rig)
        for line in lines:
            print(json.dumps(answer_plainly(oracle, line), ensure_ascii=False))
        return 0
    if options.answers is None:
        parser.error("no answers to judge")
    tally = judge_all(rig, options.graph.name, lines, _lines(options.answers))
    print(tally.report())
    return 1 if tally.wrong else 0


def _requests(path: Path) -> list[Line]:
    return [line if isinstance(line, dict) else {} for line in _lines(path)]


def _lines(path: Path) -> list[object]:
    return parse_lines(path.read_text("utf-8"))


def _print_oracle(oracle: Oracle, lines: list[Line]) -> None:
    for line in lines:
        try:
            finding = oracle.ask(parse_request(line))
        except NoRequestError as error:
            print(json.dumps({**line, "answer": "no request", "why": str(error)}))
            continue
        chain = [leg.pump for leg in finding.legs]
        said = {"answer": finding.answer, "why": finding.why, "pumps": chain}
        said["breaks"] = sorted(finding.break_ids)
        print(json.dumps({**line, **said}, ensure_ascii=False))


if __name__ == "__main__":
    sys.exit(main())
