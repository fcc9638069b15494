"""Devices that are halted: no schedule violates anything, and every rule is needed."""

from __future__ import annotations

import pytest

from tests.simulation import halt_mutants as rules
from tests.simulation import halts, mutants
from tests.simulation.__main__ import play
from tests.simulation.blocks import blocks
from tests.simulation.checks import ViolationError
from tests.simulation.mutants import Mutant
from tests.simulation.test_mutants import name_of

IN_TEST = 600

SEEDS: dict[Mutant, tuple[int, str]] = {
    rules.owed_halt_is_forgotten: (1, "H5"),
    rules.owed_halt_in_memory: (0, "H5"),
    rules.owed_halt_holds_nothing: (31, "H1"),
    rules.refused_halt_counts: (1, "H5"),
    rules.stop_owes_nothing: (5, "H1"),
    rules.stop_spares_what_acts: (47, "H4"),
    rules.last_cause_counts: (1, "H5"),
    rules.later_action_is_not_told: (52, "H5"),
    rules.halt_voids_nothing: (2, "H2"),
    rules.late_halt_voids_nothing: (0, "H5"),
    rules.given_up_and_kept: (389, "H2"),
    rules.interrupted_and_kept: (15, "H2"),
    rules.end_ignores_a_halt: (12, "H2"),
    rules.steps_stand_after_a_halt: (2, "H3"),
}
"""Seed that kills a mutant, and the invariant that it violates."""


@pytest.mark.parametrize("seeds", blocks(IN_TEST, 200_000, blocks_count=4), ids=str)
def test_no_schedule_of_halts_violates_an_invariant(seeds: range) -> None:
    found = play(seeds, halts.run)
    lines = [f"python -m tests.simulation --halts --seeds {seed}  {text}" for seed, text in found]
    assert not found, "\n".join(lines[:10])


def test_every_mutant_has_a_seed_that_kills_it() -> None:
    assert set(rules.OF_HALTS) == SEEDS.keys()


def test_the_schedules_of_make_test_kill_every_mutant_of_a_seed() -> None:
    assert max(seed for seed, _ in SEEDS.values()) < IN_TEST


@pytest.mark.parametrize("mutant", SEEDS, ids=name_of)
def test_a_pinned_seed_finds_out_that_a_rule_is_gone(mutant: Mutant) -> None:
    seed, invariant = SEEDS[mutant]
    halts.run(seed)
    with mutants.mutated(mutant), pytest.raises(ViolationError, match=rf"^{invariant}:"):
        halts.run(seed)
