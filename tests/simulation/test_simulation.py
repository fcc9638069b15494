"""Schedules of faults from seeds: nothing is violated, and one seed is one schedule.

The counts are those of `make test`; `make soak` plays a million, other ones each `SEED`.
"""

from __future__ import annotations

import os

import pytest

from tests.simulation.__main__ import play
from tests.simulation.schedule import run
from tests.simulation.test_mutants import SEEDS

BLOCKS = 20
IS_SOAK = bool(os.environ.get("LABWEB_SOAK"))
IN_TEST = 10_000
"""Far more than kill every mutant that a schedule of a seed kills."""

COUNT = 1_000_000 if IS_SOAK else IN_TEST
FIRST = int(os.environ.get("LABWEB_SEED", "0")) * COUNT if IS_SOAK else 0
SIZE = COUNT // BLOCKS


@pytest.mark.parametrize("block", range(BLOCKS))
def test_no_schedule_of_faults_violates_an_invariant(block: int) -> None:
    first = FIRST + block * SIZE
    found = play(range(first, first + SIZE))
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
