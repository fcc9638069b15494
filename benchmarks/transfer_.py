"""Liquid transfers through the whole service path, beside psycopg writing as many rows."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from uuid import UUID

from django.db import connection
from django.db.transaction import atomic, set_rollback
from django.test.utils import CaptureQueriesContext

from benchmarks.bare import Bare, Rows, between, written
from benchmarks.figures import Figure, Options, timed
from benchmarks.labs import a_lab, grow
from labweb.accounts.selectors import User
from labweb.crutd import services
from labweb.crutd.services import Settlement
from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.resources.selectors import Lab

MOST_QUERIES = 13
"""One of them asks which run holds the vessels."""

LEAST_SHARE = 25.0
ROUNDS = 10
TREES = (100, 100_000)
"""Resources beside which a transfer is counted: the number of queries must not follow."""

_DONE = Settlement(outcome=Outcome(kind=OutcomeKind.DONE), verification="assumed")
_CONTROL = ("BEGIN", "COMMIT")


@dataclass
class Bench:
    """Two vessels, and which of them is poured from next."""

    lab: Lab
    ends: tuple[UUID, UUID]
    person: UUID

    def _operation(self) -> TransferLiquid:
        source, target = self.ends
        self.ends = (target, source)
        return TransferLiquid(source_id=source, target_id=target, amount_nl=1_000)

    def by_hand(self) -> None:
        """Lock, check, post, record and release in one transaction."""
        services.carry_out(self._operation(), lab=self.lab, actor_id=self.person)

    def lock(self) -> UUID:
        """Do what is done before a device acts, in a transaction of its own."""
        row = services.lock_operation(self._operation(), lab=self.lab, targets=(), actor_id=None)
        return row.id

    def by_a_device(self) -> None:
        """Lock, and settle when the device has reported: two transactions."""
        services.settle(self.lock(), _DONE)


def figures(options: Options) -> Iterator[Figure]:
    """Count queries at two sizes of the tree, then race; `size` transfers of each kind.

    A `size` of one's own makes the larger tree small too.
    """
    lab = a_lab(wells=2)
    ids = grow(lab, TREES[0])
    bench = Bench(lab, (ids["A1"], ids["A2"]), User.objects.create(username="hand").pk)
    for nodes in TREES if options.size is None else (TREES[0], 10 * TREES[0]):
        grow(lab, nodes)
        for name, act in (("by hand", bench.by_hand), ("by a device", bench.by_a_device)):
            yield Figure(
                name=f"queries of a transfer {name}, {nodes} resources",
                value=queries(act),
                unit="",
                limit=MOST_QUERIES,
            )
    yield from _race(bench, max(1, (options.size or 2_000) // ROUNDS))


def queries(act: Callable[[], object]) -> int:
    """Return how many statements an act sends, BEGIN and COMMIT aside."""
    with CaptureQueriesContext(connection) as sent:
        act()
    return sum(query["sql"] not in _CONTROL for query in sent)


def rows_of(*acts: Callable[[], object]) -> list[Rows]:
    """Return what each act writes; nothing of it stays."""
    with atomic():
        counts = [written()]
        for act in acts:
            act()
            counts.append(written())
        set_rollback(True)
    return [between(*pair) for pair in pairwise(counts)]


def _race(bench: Bench, count: int) -> Iterator[Figure]:
    bench.by_hand()
    [by_hand] = rows_of(bench.by_hand)
    held: list[UUID] = []
    split = rows_of(lambda: held.append(bench.lock()), lambda: services.settle(held.pop(), _DONE))
    bare = Bare()
    acts: dict[str, Callable[[], object]] = {
        "bare, one transaction": lambda: bare.write(by_hand),
        "by hand": bench.by_hand,
        "bare, two transactions": lambda: bare.write(*split),
        "by a device": bench.by_a_device,
    }
    times: dict[str, list[float]] = {name: [] for name in acts}
    for act in acts.values():
        act()
    # Taken in turns, so that what else the machine does meets all of them.
    for _ in range(ROUNDS):
        for name, act in acts.items():
            times[name] += [timed(act) for _ in range(count)]
    bare.close()
    rows = sum(map(sum, by_hand.values()))
    yield Figure(name="rows that a transfer inserts and updates", value=rows, unit="")
    for name, taken in times.items():
        yield Figure(name=name, value=1 / statistics.median(taken), unit="/s")
    for peer, name in (
        ("bare, one transaction", "by hand"),
        ("bare, two transactions", "by a device"),
    ):
        share = 100 * statistics.median(times[peer]) / statistics.median(times[name])
        yield Figure(
            name=f"{name}: share of the bare rate",
            value=share,
            unit="%",
            limit=LEAST_SHARE,
            is_floor=True,
        )
