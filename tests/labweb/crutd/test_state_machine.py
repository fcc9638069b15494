"""Whatever is done to a lab, in whatever order: the invariants hold, and a broken rule is seen."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, core, settings
from hypothesis.stateful import run_state_machine_as_test

from labweb.crutd import services
from labweb.crutd.selectors.event_chain import event_hash
from labweb.crutd.services import events, locks, transactions
from labweb.crutd.services.ledger_posting import post
from labweb.domain.crutd import operation_checks, settlement, transaction_states
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.resources.contents_by_lot import take
from labweb.resources import services as resource_services
from tests.labweb.crutd.machine import LAB_FILE, LabMachine

IS_SOAK = "LABWEB_SOAK" in os.environ
ENOUGH = 200
"""Examples within which every broken rule is seen."""

BLOCKS, EXAMPLES = (20, 100) if IS_SOAK else (1, 40)
"""Each block has a database transaction of its own: one for all grows slower with each example."""

FIRST = int(os.environ.get("LABWEB_SEED", "0")) * BLOCKS
STEPS = 50
pytestmark = [pytest.mark.slow, pytest.mark.timeout(0 if IS_SOAK else 600)]
SLOW = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.function_scoped_fixture]


@pytest.fixture
def small_lab(db: None) -> None:
    services.import_lab(read_lab(json.dumps(LAB_FILE).encode()), actor=None, source={})


@pytest.mark.usefixtures("small_lab")
@pytest.mark.parametrize("block", range(BLOCKS))
def test_a_lab_worked_at_random_keeps_every_invariant(
    block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    if IS_SOAK:
        monkeypatch.setattr(core, "global_force_seed", FIRST + block)
    chosen = settings(max_examples=EXAMPLES, stateful_step_count=STEPS, suppress_health_check=SLOW)
    run_state_machine_as_test(LabMachine, settings=chosen)


def less(draw: Callable[..., dict[Any, int]]) -> Callable[..., dict[Any, int]]:
    """Lose a nanolitre of every larger draw."""
    return lambda contents, amount: draw(contents, amount - (amount > 10))


def nothing(*_args: object, **_options: object) -> list[object]:
    """Do nothing, and find nothing wrong."""
    return []


def unreleased(write: Callable[..., None]) -> Callable[..., None]:
    """Forget to release what was reserved."""
    return lambda row, postings, _released: write(row, postings, ())


def silent(*_args: object) -> None:
    """Tell nobody."""


def bodiless(prev: str, seq: int, at: str, about: str, _body: object) -> str:
    """Hash an event without what it says."""
    return event_hash(prev, seq, at, about, {})


MUTANTS: dict[str, tuple[object, str, Any, str]] = {
    "a draw loses a nanolitre": (settlement, "take", less(take), "I3"),
    "every step is allowed": (transaction_states, "check_step", nothing, "cannot go from|I7"),
    "locks do not exclude": (
        locks,
        "conflicts",
        nothing,
        "one_exclusive_lock|never_overdrawn|I9|I10",
    ),
    "a reservation stays": (transactions, "post", unreleased(post), "reserves|I10"),
    "anything stands in anything": (operation_checks, "_check_carry", nothing, "own_parent|I11"),
    "a difference opens no ticket": (transactions, "open_ticket", silent, "I12"),
    "the hash forgets the body": (events, "event_hash", bodiless, "I21"),
    "a change is not counted": (resource_services, "raise_revs", silent, "I22"),
}
"""A rule, what it becomes, and what is seen then: the database or the invariant."""


class HostsAlone(LabMachine):
    """Only what hosts do: what a difference between edge and server needs to be frequent."""

    pour = crash = receive = dispose = take_stock = None  # type: ignore[assignment]
    carry = archive_or_restore = step = None  # type: ignore[assignment]


MACHINES = {"a difference opens no ticket": HostsAlone}


@pytest.mark.usefixtures("small_lab")
@pytest.mark.parametrize("mutant", MUTANTS)
def test_the_machine_sees_a_rule_that_is_broken(
    mutant: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    where, name, broken, seen = MUTANTS[mutant]
    monkeypatch.setattr(where, name, broken)
    chosen = settings(
        max_examples=ENOUGH,
        stateful_step_count=STEPS,
        derandomize=True,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=SLOW,
        report_multiple_bugs=False,
    )
    with pytest.raises(Exception, match=seen):
        run_state_machine_as_test(MACHINES.get(mutant, LabMachine), settings=chosen)
