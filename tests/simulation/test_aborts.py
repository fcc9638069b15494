"""Runs that are aborted and devices that are stopped: no schedule violates anything."""

from __future__ import annotations

import pytest

from tests.simulation import abort_mutants as rules
from tests.simulation import aborts, mutants
from tests.simulation.__main__ import play
from tests.simulation.blocks import blocks
from tests.simulation.checks import ViolationError
from tests.simulation.mutants import Mutant
from tests.simulation.test_mutants import name_of

IN_TEST = 300

SEEDS: dict[Mutant, tuple[int, str]] = {
    rules.halt_is_not_owed: (0, "I8"),
    rules.halt_is_taken_twice: (1, "H7"),
    rules.stop_of_a_device_spares_what_acts: (254, "H4"),
    rules.what_waits_begins_after_a_stop: (11, "H9"),
    rules.nothing_stands: (32, "H6"),
    rules.what_was_given_up_stands: (921, "H6"),
    rules.run_ends_before_its_halts: (1, "H8"),
    rules.run_never_ends: (1, "H8"),
}
"""Seed that kills a mutant, and the invariant that it violates."""


@pytest.mark.parametrize("seeds", blocks(IN_TEST, 200_000, blocks_count=4), ids=str)
def test_no_schedule_of_aborts_violates_an_invariant(seeds: range) -> None:
    found = play(seeds, aborts.run)
    lines = [f"python -m tests.simulation --aborts --seeds {seed}  {text}" for seed, text in found]
    assert not found, "\n".join(lines[:10])


def test_every_mutant_of_an_abort_has_a_seed_that_kills_it() -> None:
    assert set(rules.OF_ABORTS) == SEEDS.keys()


@pytest.mark.parametrize("mutant", SEEDS, ids=name_of)
def test_a_pinned_seed_finds_out_that_a_rule_of_aborts_is_gone(mutant: Mutant) -> None:
    seed, invariant = SEEDS[mutant]
    aborts.run(seed)
    with mutants.mutated(mutant), pytest.raises(ViolationError, match=rf"^{invariant}:"):
        aborts.run(seed)
