"""Runs that keep what they use: no schedule violates anything, and every rule is needed."""

from __future__ import annotations

import pytest

from tests.simulation import hold_mutants as rules
from tests.simulation import holding, mutants
from tests.simulation.__main__ import play
from tests.simulation.blocks import blocks
from tests.simulation.checks import ViolationError
from tests.simulation.mutants import Mutant
from tests.simulation.test_mutants import name_of

IN_TEST = 400

SEEDS: dict[Mutant, tuple[int, str]] = {
    rules.granted_without_safety: (0, "I8"),
    rules.order_is_not_kept: (0, "W2"),
    rules.released_too_early: (0, "W1"),
    rules.never_released: (0, "I8"),
    rules.held_by_nobody: (0, "W1"),
    rules.claimed_at_first_use: (1, "W1"),
}
"""Seed that kills a mutant, and the invariant that it violates."""


@pytest.mark.parametrize("seeds", blocks(IN_TEST, 20_000, blocks_count=4), ids=str)
def test_no_schedule_of_runs_that_hold_their_vessels_violates_an_invariant(seeds: range) -> None:
    found = play(seeds, holding.run)
    lines = [f"python -m tests.simulation --holds --seeds {seed}  {text}" for seed, text in found]
    assert not found, "\n".join(lines[:10])


def test_every_mutant_of_holds_has_a_seed_that_kills_it() -> None:
    assert set(rules.OF_HOLDS) == SEEDS.keys()


@pytest.mark.parametrize("mutant", SEEDS, ids=name_of)
def test_a_pinned_seed_finds_out_that_a_rule_of_holds_is_gone(mutant: Mutant) -> None:
    seed, invariant = SEEDS[mutant]
    holding.run(seed)
    with mutants.mutated(mutant), pytest.raises(ViolationError, match=rf"^{invariant}:"):
        holding.run(seed)
