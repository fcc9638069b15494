"""Ask a compiler as a subprocess, judge every line, and count."""

from __future__ import annotations

import gzip
import itertools
import json
import os
import random
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path

from tests.judge.oracle import Oracle
from tests.judge.reading import NoGraphError, read_rig
from tests.judge.rig import Rig
from tests.judge.verdict import Mark, Verdict, judge

Line = dict[str, object]
VOLUMES = ("0.1 mL", "10 mL", "60 mL")
ROOT = Path(__file__).parents[2]
COMMAND = (sys.executable, str(ROOT / "manage.py"), "compile_transfers")
_EXAMPLES = 20
_SETTINGS = "DJANGO_SETTINGS_MODULE"
"""Set by the tests for themselves; the compiler runs as it does for a user."""


@dataclass
class Tally:
    """Counts of verdicts, with the first examples of what is wrong."""

    marks: Counter[Mark] = field(default_factory=Counter)
    codes: Counter[str] = field(default_factory=Counter)
    notes: Counter[str] = field(default_factory=Counter)
    examples: list[str] = field(default_factory=list)

    @property
    def wrong(self) -> int:
        """Count what is wrong."""
        return self.marks[Mark.WRONG]

    def add(self, where: str, line: Mapping[str, object], verdict: Verdict) -> None:
        """Count one verdict."""
        self.marks[verdict.mark] += 1
        self.notes.update(verdict.notes)
        if verdict.mark is Mark.WRONG:
            self.codes[verdict.code] += 1
            if self.codes[verdict.code] <= 3 and len(self.examples) < _EXAMPLES:
                asked = json.dumps(line, ensure_ascii=False)
                self.examples.append(f"{where}: {asked}: {verdict.code}: {verdict.message}")

    def merge(self, other: Tally) -> None:
        """Add the counts of another tally."""
        self.marks += other.marks
        self.codes += other.codes
        self.notes += other.notes
        self.examples = (self.examples + other.examples)[:_EXAMPLES]

    def report(self) -> str:
        """Say all of it."""
        lines = [f"{count:7} {mark}" for mark, count in sorted(self.marks.items())]
        lines += [f"{count:7}   {code}" for code, count in self.codes.most_common()]
        lines += [f"{count:7}   taken for granted: {note}" for note, count in self.notes.items()]
        return "\n".join(lines + self.examples)


def judge_all(rig: Rig, where: str, lines: Sequence[Line], answers: Sequence[object]) -> Tally:
    """Judge the answers to all lines; a missing or superfluous one is wrong."""
    tally, oracle = Tally(), Oracle(rig)
    for line, answer in itertools.zip_longest(lines, answers):
        tally.add(where, line or {}, judge(oracle, line or {}, answer))
    return tally


def parse_lines(text: str) -> list[object]:
    """Return the JSON value of each line, numbers exact; a line that is no JSON is None."""
    found: list[object] = []
    lines = text.split("\n")  # splitlines would also cut at U+2028 inside a string
    for line in lines[:-1] if not lines[-1] else lines:
        try:
            found.append(json.loads(line, parse_float=Decimal))
        except json.JSONDecodeError:
            found.append(None)
    return found


def ask_compiler(
    graph: Path,
    lines: Iterable[Line],
    scratch: Path,
    *,
    command: Sequence[str] = COMMAND,
    timeout_s: float = 3600,
) -> list[object]:
    """Let a compiler answer the lines for a graph file, in a process of its own."""
    requests = scratch / "requests.jsonl"
    asked = [json.dumps(line, ensure_ascii=False) for line in lines]
    requests.write_text("".join(line + "\n" for line in asked), "utf-8")
    done = subprocess.run(
        [*command, str(unpacked(graph, scratch)), str(requests)],
        capture_output=True,
        cwd=ROOT,
        env={name: value for name, value in os.environ.items() if name != _SETTINGS},
        timeout=timeout_s,
        check=False,
    )
    answers = parse_lines(done.stdout.decode("utf-8"))
    if len(answers) != len(asked):
        said = done.stderr.decode("utf-8", "replace")[-2000:]
        raise AssertionError(
            f"{graph.name}: {len(asked)} requests, {len(answers)} answers, "
            f"exit code {done.returncode}\n{said}"
        )
    return answers


def unpacked(graph: Path, scratch: Path) -> Path:
    """Return a graph file without its compression."""
    if graph.suffix != ".gz":
        return graph
    plain = scratch / graph.stem
    plain.write_bytes(gzip.decompress(graph.read_bytes()))
    return plain


def wet_graphs(folders: Iterable[Path]) -> list[Path]:
    """List the graph files below the folders that have a hose."""
    found = []
    for path in sorted(itertools.chain(*(folder.rglob("*") for folder in folders))):
        if path.name.endswith((".json", ".graphml", ".graphml.gz")):
            try:
                rig = read_rig(path)
            except NoGraphError:
                continue
            if rig.hoses:
                found.append(path)
    return found


def pairs(rig: Rig, volumes: Iterable[str] = VOLUMES) -> list[Line]:
    """List every ordered pair of vessels with every volume."""
    names = itertools.permutations(rig.vessels(), 2)
    asked = itertools.product(names, volumes)
    return [{"from": a, "to": b, "volume": volume} for (a, b), volume in asked]


def sample(lines: list[Line], most: int, seed: str) -> list[Line]:
    """Take at most so many lines, the same ones for the same seed."""
    if len(lines) <= most:
        return lines
    return random.Random(seed).sample(lines, most)
