"""I11: a resource is in one host's tree or on its way, whatever is lost, repeated or overtaken."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from uuid import UUID

import msgspec
import pytest

from labweb.domain.errors import StateError
from labweb.domain.messages.commands import Release, ResourceView
from labweb.domain.runs.exclusive_use import resource_custody
from labweb.domain.runs.exclusive_use.resource_custody import CustodyState, ResourceCustody
from labweb.domain.runs.host_journal.journal_rows import JournalWrite
from tests.simulation.checks import ViolationError
from tests.simulation.lab import id_of
from tests.simulation.memory import MemoryWrite
from tests.simulation.moving import play

COUNT = 20_000 if os.environ.get("LABWEB_SOAK") else 200
A, B, VIAL, MOVE = id_of(1), id_of(2), id_of(3), id_of(4)
OWNED = ResourceCustody(resource_id=VIAL, state=CustodyState.OWNED, owner=A)
VIEW = ResourceView(id=VIAL, name="vial", kind="vial", rev=4)
Patch = pytest.MonkeyPatch


def test_no_schedule_brings_a_vial_into_two_trees_or_none() -> None:
    assert play_all(COUNT) > COUNT


def play_all(count: int) -> int:
    return sum(play(seed) for seed in range(count))


def told_twice(patch: Patch) -> None:
    """A host takes the same move again."""
    patch.setattr(MemoryWrite, "is_first_refusal", lambda self, subject: True)


def released_in_use(patch: Patch) -> None:
    """A host lets go what one of its actions holds."""
    real = resource_custody.take_release

    def take(tx: JournalWrite, release: Release, *, in_use: object) -> bool:
        return real(tx, release, in_use=())

    patch.setattr(resource_custody, "take_release", take)


def moved_while_moving(patch: Patch) -> None:
    """A thing on its way is sent elsewhere."""
    real = resource_custody.ask

    def asked(
        known: ResourceCustody, *, transfer_id: UUID, target: UUID, in_use: object
    ) -> ResourceCustody:
        still = ResourceCustody(
            resource_id=known.resource_id,
            state=CustodyState.OWNED,
            owner=known.owner or A,
        )
        return real(still, transfer_id=transfer_id, target=target, in_use=())

    patch.setattr(resource_custody, "ask", asked)


def kept_by_the_first(patch: Patch) -> None:
    """The first host goes on to write what it let go."""
    patch.setattr(MemoryWrite, "drop_resource", lambda self, resource_id: None)


def parts_stay_behind(patch: Patch) -> None:
    """What stands in a thing stays in the first host's hands."""
    real = resource_custody.take_release

    def take(tx: JournalWrite, release: Release, *, in_use: Collection[UUID]) -> bool:
        return real(tx, msgspec.structs.replace(release, parts=[]), in_use=in_use)

    patch.setattr(resource_custody, "take_release", take)


def parts_may_be_in_use(patch: Patch) -> None:
    """Only the thing itself is asked whether it is in use."""
    real = resource_custody.take_release

    def take(tx: JournalWrite, release: Release, *, in_use: Collection[UUID]) -> bool:
        return real(tx, release, in_use={release.resource_id} & set(in_use))

    patch.setattr(resource_custody, "take_release", take)


OF_CUSTODY = (
    told_twice,
    released_in_use,
    moved_while_moving,
    kept_by_the_first,
    parts_stay_behind,
    parts_may_be_in_use,
)


@pytest.mark.parametrize("mutant", OF_CUSTODY)
def test_every_rule_of_custody_is_needed(
    monkeypatch: Patch, mutant: Callable[[Patch], None]
) -> None:
    mutant(monkeypatch)
    with pytest.raises((ViolationError, StateError)):
        play_all(60)


def test_a_thing_is_handed_only_to_another_host_that_is_still_there() -> None:
    assert resource_custody.next_hands(A, B) == B
    for owner, wanted in ((A, A), (None, B), (A, None)):
        assert resource_custody.next_hands(owner, wanted) is None
    assert resource_custody.next_hands(A, B, gone={A}) is None
    assert resource_custody.next_hands(A, B, gone={B}) is None


def test_a_thing_in_use_or_on_its_way_is_not_sent_off() -> None:
    with pytest.raises(StateError, match="uses it"):
        resource_custody.ask(OWNED, transfer_id=MOVE, target=B, in_use={VIAL})
    with pytest.raises(StateError, match="already"):
        resource_custody.ask(OWNED, transfer_id=MOVE, target=A, in_use=())
    leaving = resource_custody.ask(OWNED, transfer_id=MOVE, target=B, in_use=())
    with pytest.raises(StateError, match="on its way"):
        resource_custody.ask(leaving, transfer_id=id_of(9), target=B, in_use=())


def test_only_the_owner_lets_go_and_only_the_target_receives() -> None:
    leaving = resource_custody.ask(OWNED, transfer_id=MOVE, target=B, in_use=())
    with pytest.raises(StateError, match="does not own"):
        resource_custody.after_released(leaving, host=B, transfer_id=MOVE, view=VIEW)
    with pytest.raises(StateError, match="does not own"):
        resource_custody.after_released(leaving, host=A, transfer_id=id_of(9), view=VIEW)
    with pytest.raises(StateError, match="not sent"):
        resource_custody.after_received(leaving, host=B, transfer_id=MOVE)
    moving = resource_custody.after_released(leaving, host=A, transfer_id=MOVE, view=VIEW)
    assert (moving.owner, moving.view) == (None, VIEW)
    with pytest.raises(StateError, match="not sent"):
        resource_custody.after_received(moving, host=A, transfer_id=MOVE)
    arrived = resource_custody.after_received(moving, host=B, transfer_id=MOVE)
    assert arrived == ResourceCustody(resource_id=VIAL, state=CustodyState.OWNED, owner=B)
    assert resource_custody.after_kept(leaving, host=A, transfer_id=MOVE) == OWNED
    assert resource_custody.after_kept(leaving, host=B, transfer_id=MOVE) == leaving
