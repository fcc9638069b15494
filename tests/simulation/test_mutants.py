"""Every rule is needed: without it, a pinned schedule violates an invariant."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.simulation import directed, directed_hosts, mutants
from tests.simulation import rule_mutants as rules
from tests.simulation.batch_mutants import OF_BATCHES
from tests.simulation.checks import ViolationError
from tests.simulation.directed import Schedule
from tests.simulation.halt_mutants import OF_HALTS
from tests.simulation.mutants import Mutant
from tests.simulation.schedule import run
from tests.simulation.test_moving import OF_CUSTODY

SEEDS: dict[Mutant, tuple[int, str]] = {
    mutants.no_dedupe: (1, "I13"),
    mutants.locks_off: (0, "I9"),
    mutants.started_after_acting: (0, "I13"),
    mutants.retry_after_crash: (11, "I13"),
    mutants.no_epoch_check: (0, "I13"),
    mutants.ignore_regression: (3, "I13"),
    mutants.accept_gaps: (42, "I5"),
    mutants.requeue_on_silence: (3, "I16"),
    mutants.no_seal: (221, "I13"),
    mutants.no_cold_boot_hold: (25, "I13"),
    mutants.hold_in_memory: (516, "I13"),
    rules.no_tombstone: (80, "Q"),
    rules.no_fork_check: (5, "I5"),
    rules.events_applied_again: (42, "I5"),
    rules.quarantine_ends_by_itself: (391, "I13"),
    rules.quarantine_keeps_jobs: (3, "I8"),
    rules.old_epoch_stays: (0, "I8"),
    rules.refusal_ends_any_job: (80, "Q"),
    rules.dependents_go_on: (3, "I17"),
    rules.nobody_is_isolated: (3, "I17"),
}
"""Seed that kills a mutant, and the invariant that it violates."""

BY_HAND: dict[Mutant, tuple[Schedule, str]] = {
    rules.no_floor: (directed.below_the_floor, "I13"),
    rules.no_fence: (directed.later_before_earlier, "I13"),
    rules.seal_moves_anyway: (directed.restored_and_outgrown, "I13"),
    rules.seal_goes_back: (directed.same_length_other_history, "I13"),
    rules.seal_of_any_journal: (directed.journal_of_before_the_reset, "I13"),
    rules.only_length_of_seal: (directed.same_length_other_history, "I13"),
    rules.answer_before_stock: (directed.answered_before_stock, "I4"),
    rules.resume_before_read: (directed.whole_disk_restored_and_outgrown, "I13"),
    rules.record_is_not_adopted: (directed.measured_after_discard, "I8"),
    rules.no_latch: (directed.stopped_and_reset, "I14"),
    rules.any_reset_opens: (directed.stopped_and_reset, "I14"),
    rules.told_before_sealed: (directed_hosts.told_and_taken_back, "I2"),
    rules.any_process_speaks: (directed_hosts.two_machines, "I1"),
    rules.boots_are_forgotten: (directed_hosts.two_machines_in_turn, "I13"),
    rules.nobody_is_heard: (directed_hosts.spoken_before, "I13"),
    rules.one_person_fences: (directed_hosts.fenced_by_two, "I16"),
    rules.lost_hosts_are_waited_for: (directed_hosts.fenced_by_two, "I8"),
    rules.doubt_does_not_close: (directed.next_on_a_doubtful_device, "I14"),
}
"""Schedule by hand that kills a mutant, and the invariant that it violates."""


FOUND = (139960, 141101)
"""Seeds that have violated an invariant once."""


def name_of(made: object) -> str:
    return getattr(made, "__name__", str(made))


def test_every_mutant_has_a_schedule_that_kills_it() -> None:
    every = {*mutants.OF_THE_PROTOCOL, *rules.OF_THE_RULES}
    assert every == SEEDS.keys() | BY_HAND.keys()
    assert len(mutants.OF_THE_PROTOCOL) == 11


def test_the_page_counts_the_mutants_that_there_are() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reliability.md").read_text("utf-8")
    kinds = (", ", " of batches, ", " of custody and ", " of halts")
    told = "".join(rf"(\d+) of \{number}{kind}" for number, kind in enumerate(kinds, start=1))
    counted = re.search(told, page)
    assert counted is not None
    found = (SEEDS.keys() | BY_HAND.keys(), OF_BATCHES, OF_CUSTODY, OF_HALTS)
    assert [int(text) for text in counted.groups()] == [len(one) for one in found]


@pytest.mark.parametrize("seed", FOUND)
def test_what_was_violated_once_is_violated_no_more(seed: int) -> None:
    run(seed)


@pytest.mark.parametrize("mutant", SEEDS, ids=name_of)
def test_a_pinned_seed_finds_out_that_a_rule_is_gone(mutant: Mutant) -> None:
    seed, invariant = SEEDS[mutant]
    run(seed)
    with mutants.mutated(mutant), pytest.raises(ViolationError, match=rf"^{invariant}:"):
        run(seed)


@pytest.mark.parametrize("mutant", BY_HAND, ids=name_of)
def test_a_schedule_by_hand_finds_out_that_a_rule_is_gone(mutant: Mutant) -> None:
    schedule, invariant = BY_HAND[mutant]
    schedule()
    with mutants.mutated(mutant), pytest.raises(ViolationError, match=rf"^{invariant}:"):
        schedule()


@pytest.mark.parametrize("schedule", [*directed.SCHEDULES, *directed_hosts.SCHEDULES], ids=name_of)
def test_a_schedule_by_hand_violates_nothing_while_every_rule_stands(schedule: Schedule) -> None:
    schedule()
