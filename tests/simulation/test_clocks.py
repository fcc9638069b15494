"""Clocks that are set: each event after its cause, before its reception, as sure as said."""

from __future__ import annotations

import pytest

from tests.simulation import clock_mutants as rules
from tests.simulation import clocks, mutants
from tests.simulation.__main__ import play
from tests.simulation.blocks import blocks
from tests.simulation.checks import ViolationError
from tests.simulation.mutants import Mutant
from tests.simulation.test_mutants import name_of

IN_TEST = 400

SEEDS: dict[Mutant, tuple[int, str]] = {
    rules.time_of_reception: (0, "T3"),
    rules.raw_time_of_the_host: (0, "T4"),
    rules.measured_wall_clock: (0, "T4"),
    rules.causes_forgotten: (0, "T1"),
    rules.reception_forgotten: (3, "T2"),
    rules.starts_confused: (3, "T3"),
    rules.clocks_run_alike: (0, "T4"),
    rules.way_takes_no_time: (0, "T3"),
    rules.only_bounds: (0, "T4"),
    rules.doubt_not_widened: (3, "T3"),
}
"""Seed that kills a mutant, and the invariant that it violates."""


@pytest.mark.parametrize("seeds", blocks(IN_TEST, 20_000, blocks_count=4), ids=str)
def test_no_schedule_of_clocks_that_are_set_violates_an_invariant(seeds: range) -> None:
    found = play(seeds, clocks.run)
    lines = [f"python -m tests.simulation --clocks --seeds {seed}  {text}" for seed, text in found]
    assert not found, "\n".join(lines[:10])


def test_every_mutant_of_clocks_has_a_seed_that_kills_it() -> None:
    assert set(rules.OF_CLOCKS) == SEEDS.keys()


@pytest.mark.parametrize("mutant", SEEDS, ids=name_of)
def test_a_pinned_seed_finds_out_that_a_rule_of_clocks_is_gone(mutant: Mutant) -> None:
    seed, invariant = SEEDS[mutant]
    clocks.run(seed)
    with mutants.mutated(mutant), pytest.raises(ViolationError, match=rf"^{invariant}:"):
        clocks.run(seed)
