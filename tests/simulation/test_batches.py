"""Runs that go in batches: no schedule violates anything, and every rule is needed."""

from __future__ import annotations

import pytest

from tests.simulation import batch_mutants as rules
from tests.simulation import batches, directed_hosts, mutants
from tests.simulation.__main__ import play
from tests.simulation.blocks import blocks
from tests.simulation.checks import ViolationError
from tests.simulation.directed import Schedule
from tests.simulation.mutants import Mutant
from tests.simulation.test_mutants import name_of

IN_TEST = 600

SEEDS: dict[Mutant, tuple[int, str]] = {
    rules.batch_out_of_order: (3, "B1"),
    rules.batch_goes_on_after_a_failure: (3, "B1"),
    rules.batch_goes_on_in_doubt: (4, "B1"),
    rules.absence_is_nothing: (13, "B2"),
    rules.leash_of_any_length: (64, "B2"),
    rules.nothing_is_stopped_safely: (0, "B3"),
    rules.locks_free_between_members: (188, "I9"),
    rules.complete_is_tried_anew: (4, "I7"),
}
"""Seed that kills a mutant, and the invariant that it violates."""

BY_HAND: dict[Mutant, Schedule] = {
    rules.absence_without_an_event: directed_hosts.absence_put_back,
    rules.absence_left_unsealed: directed_hosts.absence_put_back_unsealed,
}
"""Schedule that kills a mutant that hardly a drawn one would."""

FOUND = (1470,)
"""Seeds that have violated an invariant once."""


@pytest.mark.parametrize("seeds", blocks(IN_TEST, 200_000, blocks_count=4), ids=str)
def test_no_schedule_of_batches_violates_an_invariant(seeds: range) -> None:
    found = play(seeds, batches.run)
    lines = [f"python -m tests.simulation --batches --seeds {seed}  {text}" for seed, text in found]
    assert not found, "\n".join(lines[:10])


def test_every_mutant_has_a_schedule_that_kills_it() -> None:
    assert set(rules.OF_BATCHES) == {*SEEDS, *BY_HAND}


def test_the_schedules_of_make_test_kill_every_mutant_of_a_seed() -> None:
    assert max(seed for seed, _ in SEEDS.values()) < IN_TEST


@pytest.mark.parametrize("seed", FOUND)
def test_what_was_violated_once_is_violated_no_more(seed: int) -> None:
    batches.run(seed)


@pytest.mark.parametrize("mutant", SEEDS, ids=name_of)
def test_a_pinned_seed_finds_out_that_a_rule_is_gone(mutant: Mutant) -> None:
    seed, invariant = SEEDS[mutant]
    batches.run(seed)
    with mutants.mutated(mutant), pytest.raises(ViolationError, match=rf"^{invariant}:"):
        batches.run(seed)


@pytest.mark.parametrize("mutant", BY_HAND, ids=name_of)
def test_a_schedule_by_hand_finds_out_what_a_copy_takes_back(mutant: Mutant) -> None:
    schedule = BY_HAND[mutant]
    schedule()
    with mutants.mutated(mutant), pytest.raises(ViolationError, match=r"^B2:"):
        schedule()


def test_a_vessel_stays_closed_for_its_first_cause() -> None:
    batches.run(1470)
