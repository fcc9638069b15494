"""What is counted, unit by unit: a graph, a rig, a pair of recipe and rig, or 250 examples."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

from hypothesis import HealthCheck, given, seed, settings

from tests.counts.record import Unit
from tests.domain.recipes.cross_rig import judged, matrix
from tests.domain.recipes.cross_rig import pairs as pairs_of_recipes
from tests.domain.recipes.invent import Invented
from tests.domain.recipes.invent import pairs as random_pairs
from tests.domain.recipes.test_cross_rig import cell
from tests.domain.recipes.test_random_plans import outcome
from tests.judge.corpora import FOLDERS, label
from tests.judge.harness import Line, Tally, ask_compiler, judge_all, pairs, wet_graphs
from tests.judge.invent import invent
from tests.judge.reading import read_rig

RIGS_PER_SEED = 200
EXAMPLES = 5000
EXAMPLES_PER_UNIT = 250


def transfers(_seed: int) -> Iterator[Unit]:
    """Yield every graph of others that has a hose."""
    for path in wet_graphs(FOLDERS):
        yield Unit(label(path), partial(_of_others, path))


def invented(from_seed: int) -> Iterator[Unit]:
    """Yield the rigs of a seed."""
    first = from_seed * RIGS_PER_SEED
    for number in range(first, first + RIGS_PER_SEED):
        yield Unit(f"rig {number}", partial(_invented, number))


def cross_rig(_seed: int) -> Iterator[Unit]:
    """Yield each pair of the published matrix of which recipe and rig are here."""
    for recipe, rig in pairs_of_recipes():
        yield Unit(f"{recipe} on {rig}", partial(_pair, recipe, rig))


def random_plans(from_seed: int) -> Iterator[Unit]:
    """Yield batches of random recipes on random rigs."""
    batches = EXAMPLES // EXAMPLES_PER_UNIT
    for number in range(from_seed * batches, (from_seed + 1) * batches):
        yield Unit(f"examples of seed {number}", partial(_examples, number))


COUNTS: Mapping[str, Callable[[int], Iterator[Unit]]] = {
    "transfers": transfers,
    "invented": invented,
    "matrix": cross_rig,
    "random": random_plans,
}


def _of_others(path: Path) -> Mapping[str, int]:
    with tempfile.TemporaryDirectory() as scratch:
        return _judged(path, pairs(read_rig(path)), Path(scratch))


def _invented(number: int) -> Mapping[str, int]:
    one = invent(number)
    with tempfile.TemporaryDirectory() as scratch:
        return _judged(one.write(Path(scratch)), one.lines, Path(scratch))


def _judged(path: Path, lines: list[Line], scratch: Path) -> Mapping[str, int]:
    answers = ask_compiler(path, lines, scratch)
    tally: Tally = judge_all(read_rig(path), path.name, lines, answers)
    assert not tally.wrong, tally.report()
    return {str(mark): number for mark, number in tally.marks.items()} | {"requests": len(lines)}


def _pair(recipe: str, rig: str) -> Mapping[str, int]:
    found = judged(recipe, rig)
    ran = matrix()[recipe, rig]["executed"] == "True"
    ours = ("R" if ran else "–") + found.ours
    assert cell(recipe, rig) == ours, f"{ours}, and the documentation says {cell(recipe, rig)}"
    assert found.is_equal is not False, "other amounts than by the reference"
    amounts = {True: "amounts equal", None: "amounts without a peer"}[found.is_equal]
    return {ours: 1} if found.ours == "x" else {ours: 1, amounts: 1}


def _examples(number: int) -> Mapping[str, int]:
    counts: Counter[str] = Counter()

    @seed(number)
    @settings(
        max_examples=EXAMPLES_PER_UNIT,
        deadline=None,
        database=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
    @given(random_pairs())
    def follow(one: Invented) -> None:
        counts[outcome(one)] += 1

    follow()
    return counts
