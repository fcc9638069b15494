"""Devices that lose what was set: no schedule violates anything, and every rule is needed."""

from __future__ import annotations

import pytest

from tests.simulation import mutants, vanishing
from tests.simulation import vanish_mutants as rules
from tests.simulation.__main__ import play
from tests.simulation.blocks import blocks
from tests.simulation.checks import ViolationError
from tests.simulation.mutants import Mutant
from tests.simulation.test_mutants import name_of

IN_TEST = 300

SEEDS: dict[Mutant, tuple[int, str]] = {
    rules.nothing_is_watched: (4, "H2"),
    rules.watched_in_memory: (4, "H2"),
    rules.loss_voids_nothing: (4, "H2"),
    rules.loss_is_told_again: (4, "V2"),
    rules.old_loss_counts: (9, "V2"),
    rules.loss_while_another_acts: (53, "V1"),
    rules.watched_after_a_halt: (6, "V1"),
}
"""Seed that kills a mutant, and the invariant that it violates."""


@pytest.mark.parametrize("seeds", blocks(IN_TEST, 200_000, blocks_count=4), ids=str)
def test_no_schedule_of_lost_setpoints_violates_an_invariant(seeds: range) -> None:
    found = play(seeds, vanishing.run)
    lines = [f"python -m tests.simulation --lost --seeds {seed}  {text}" for seed, text in found]
    assert not found, "\n".join(lines[:10])


def test_every_mutant_has_a_seed_that_kills_it() -> None:
    assert set(rules.OF_LOSSES) == SEEDS.keys()


def test_the_schedules_of_make_test_kill_every_mutant_of_a_seed() -> None:
    assert max(seed for seed, _ in SEEDS.values()) < IN_TEST


@pytest.mark.parametrize("mutant", SEEDS, ids=name_of)
def test_a_pinned_seed_finds_out_that_a_rule_is_gone(mutant: Mutant) -> None:
    seed, invariant = SEEDS[mutant]
    vanishing.run(seed)
    with mutants.mutated(mutant), pytest.raises(ViolationError, match=rf"^{invariant}:"):
        vanishing.run(seed)
