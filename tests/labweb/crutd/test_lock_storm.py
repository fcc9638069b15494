"""Many processes want overlapping resources at once; a count outside the database judges."""

from __future__ import annotations

import multiprocessing
import os
import random
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta
from multiprocessing.sharedctypes import SynchronizedArray
from queue import Empty
from uuid import UUID

import pytest
from django.db import OperationalError, connections

from labweb.crutd import services
from labweb.crutd.models import ResourceLock, ResourceReservation
from labweb.crutd.services import Settlement
from labweb.domain.crutd.operations import Read
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.domain.errors import LockedError
from labweb.resources.models import Resource
from labweb.resources.selectors import Lab
from tests.builders import a_lab, a_user

IS_SOAK = "LABWEB_SOAK" in os.environ
PROCESSES, REQUESTS = (16, 10_000) if IS_SOAK else (4, 60)
STARVED_S = 5.0
RESERVE_AFTER_S = 1.0
SHORTEST_PAUSE_S = 0.005
LONGEST_PAUSE_S = {False: 0.16, True: 0.04}
"""Without a reservation and with one."""


pytestmark = [
    pytest.mark.django_db(transaction=True),
    pytest.mark.slow,
    pytest.mark.timeout(0 if IS_SOAK else 300),
]


@dataclass(frozen=True)
class Field:
    """What is fought over: a tree of 30 resources, and who uses what, outside the database."""

    ids: Sequence[UUID]
    above: Sequence[Sequence[int]]
    """Places of everything above each."""

    held: SynchronizedArray[int]
    """Exclusive use by place, then use of something below by place."""

    def enter(self, places: Sequence[int]) -> bool:
        """Note a use, and tell whether nobody else had any of it."""
        count = len(self.ids)
        with self.held.get_lock():
            above = {node for place in places for node in self.above[place]} - set(places)
            is_free = not any(self.held[place] or self.held[count + place] for place in places)
            is_free = is_free and not any(self.held[node] for node in above)
            for place in places:
                self.held[place] += 1
            for node in above:
                self.held[count + node] += 1
            return is_free

    def leave(self, places: Sequence[int]) -> None:
        """Note that the use is over."""
        count = len(self.ids)
        with self.held.get_lock():
            for place in places:
                self.held[place] -= 1
            for node in {node for place in places for node in self.above[place]} - set(places):
                self.held[count + node] -= 1


@dataclass
class Score:
    """What one process saw."""

    double: int = 0
    deadlocks: int = 0
    longest_s: float = 0.0
    done: int = 0


def a_field(lab: Lab) -> Field:
    """Make a bench with five plates of four wells, and more benches: 30 resources."""
    root = Resource.objects.get(lab=lab, parent=None)
    made = [make(lab, root, f"storm_{n}", "bench") for n in range(5)]
    plates = [make(lab, made[0], f"plate_{n}", "plate") for n in range(5)]
    wells = [make(lab, plate, f"{plate.key}/A{n}", "well") for plate in plates for n in range(1, 5)]
    rows = [*made, *plates, *wells]
    place = {row.id: number for number, row in enumerate(rows)}
    above: list[list[int]] = []
    for row in rows:
        chain = []
        parent = row.parent
        while parent is not None:
            if parent.id in place:
                chain.append(place[parent.id])
            parent = parent.parent
        above.append(chain)
    held = multiprocessing.get_context("fork").Array("i", 2 * len(rows))
    return Field([row.id for row in rows], above, held)


def make(lab: Lab, parent: Resource, key: str, kind: str) -> Resource:
    return Resource.objects.create(
        lab=lab, parent=parent, key=key, name=key, kind=kind, nature="resource"
    )


def fight(
    field: Field, lab: Lab, seed: int, holder_id: UUID, scores: multiprocessing.Queue[Score]
) -> None:
    """Lock, use and release some of them, again and again."""
    choice, score = random.Random(seed), Score()
    for _ in range(REQUESTS):
        places = choice.sample(range(len(field.ids)), choice.randint(1, 3))
        begun_s = time.monotonic()
        transaction_id = acquire(field, lab, places, choice, score, holder_id)
        score.longest_s = max(score.longest_s, time.monotonic() - begun_s)
        score.double += not field.enter(places)
        time.sleep(choice.random() * 0.002)
        field.leave(places)
        services.settle(transaction_id, Settlement(outcome=Outcome(kind=OutcomeKind.DONE)))
        score.done += 1
    part_from_the_server()
    scores.put(score)


def part_from_the_server() -> None:
    """Close what a child must not share with its parent: connections and their pool."""
    connections.close_all()
    close_pool = getattr(connections["default"], "close_pool", None)
    if close_pool is not None:
        close_pool()


def acquire(
    field: Field,
    lab: Lab,
    places: Sequence[int],
    choice: random.Random,
    score: Score,
    holder_id: UUID,
) -> UUID:
    """Ask until the locks are there, with pauses that grow; who has waited long reserves them.

    A request that is refused costs the processor half of one that is granted, so that those who
    ask without a pause take it from those who hold what they wait for. And one who wants a whole
    bench would be overtaken for ever by those who want a well of it.
    """
    ids = [field.ids[place] for place in places]
    begun_s, pause_s = time.monotonic(), SHORTEST_PAUSE_S
    reserved: list[ResourceReservation] = []
    while True:
        try:
            if not reserved and time.monotonic() - begun_s > RESERVE_AFTER_S:
                reserved = services.reserve(
                    ids, holder_id=holder_id, lasts=timedelta(minutes=1), reason="has waited long"
                )
                pause_s = SHORTEST_PAUSE_S
            if services.is_free(ids, actor_id=holder_id):
                row = services.lock_operation(
                    Read(device_id=ids[0]), lab=lab, targets=ids[1:], actor_id=holder_id
                )
                for one in reserved:
                    services.end_reservation(one.pk, actor_id=holder_id)
                return row.id
        except LockedError:
            pass
        except OperationalError as error:
            score.deadlocks += "deadlock" in str(error)
            raise
        time.sleep(choice.uniform(pause_s / 2, pause_s))
        pause_s = min(2 * pause_s, LONGEST_PAUSE_S[bool(reserved)])


def test_no_resource_has_two_users_no_ring_of_waiters_and_nobody_starves() -> None:
    lab = a_lab().lab
    field = a_field(lab)
    bench = Resource.objects.get(pk=field.ids[0])
    holders = [a_user("chemist", on=bench, name=f"fighter_{n}").pk for n in range(PROCESSES)]
    part_from_the_server()
    context = multiprocessing.get_context("fork")
    scores: multiprocessing.Queue[Score] = context.Queue()
    fighters = [
        context.Process(target=fight, args=(field, lab, seed, holder, scores))
        for seed, holder in enumerate(holders)
    ]
    for fighter in fighters:
        fighter.start()
    try:
        told = [scored(scores, fighters) for _ in fighters]
    finally:
        # One that goes on would stand in the way of whoever empties the database.
        for fighter in fighters:
            fighter.terminate()
            fighter.join()
    assert sum(score.done for score in told) == PROCESSES * REQUESTS
    assert sum(score.double for score in told) == 0
    assert sum(score.deadlocks for score in told) == 0
    assert max(score.longest_s for score in told) < STARVED_S
    assert not ResourceLock.objects.filter(released_at__isnull=True).exists()


def scored(scores: multiprocessing.Queue[Score], fighters: Sequence[object]) -> Score:
    """Wait for the next score, and not for one that will never come."""
    while True:
        try:
            return scores.get(timeout=1)
        except Empty:
            assert all(getattr(fighter, "exitcode", 0) in {None, 0} for fighter in fighters)
