"""Schedules of faults from seeds: nothing is violated, and one seed is one schedule.

The counts are those of `make test`; `make soak` plays a million, other ones each `SEED`.
"""

from __future__ import annotations

import pytest

from tests.simulation.__main__ import play
from tests.simulation.blocks import blocks
from tests.simulation.schedule import run
from tests.simulation.test_mutants import SEEDS

IN_TEST = 10_000
"""Far more than kill every mutant that a schedule of a seed kills."""


@pytest.mark.parametrize("seeds", blocks(IN_TEST, 1_000_000, blocks_count=20), ids=str)
def test_no_schedule_of_faults_violates_an_invariant(seeds: range) -> None:
    found = play(seeds)
    lines = [f"python -m tests.simulation --seeds {seed}   {text}" for seed, text in found[:10]]
    assert not found, "\n".join(lines)


def test_the_schedules_of_make_test_kill_every_mutant_of_a_seed() -> None:
    assert max(seed for seed, _ in SEEDS.values()) < IN_TEST


def test_one_seed_is_one_schedule() -> None:
    first: list[str] = []
    second: list[str] = []
    run(11, trace=first)
    run(11, trace=second)
    assert first == second
    assert len(first) > 20
