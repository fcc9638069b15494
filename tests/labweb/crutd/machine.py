"""A lab worked at random: operations, faults, doubts and answers, with what must hold throughout.

The machine keeps its own count of what each vessel holds, and compares. I3 is matter, I7 states,
I9 locks, I10 what an ended transaction leaves, I11 the tree, I12 that edge and server agree or a
ticket says so, I21 the chain, I22 the rebuild.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any
from uuid import UUID, uuid4

from django.db import connection
from django.db.transaction import atomic, set_rollback
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from labweb.crutd import selectors, services
from labweb.crutd.models import Event, Holding, ResourceLock, Ticket, Transaction
from labweb.crutd.selectors.event_chain import first_broken_event
from labweb.crutd.selectors.history_replay import rebuild_differences
from labweb.crutd.selectors.ledger_verification import ledger_violations
from labweb.crutd.services import Settlement
from labweb.domain.crutd import operations, transaction_states
from labweb.domain.crutd import settlement as decide
from labweb.domain.crutd.ledger import Account
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.errors import LabError
from labweb.domain.resources.contents_by_lot import Phase
from labweb.resources.models import Lab, Lot, Resource

VESSELS = ("bottle", "jug", "flask", "cup", "vial")
THINGS = (*VESSELS, "rack", "bench", "tray")
PLACES = ("lab", "bench", "rack", "tray", "archive")
KINDS = st.sampled_from(["done", "half", "none", "unknown", "too much", "drift"])
AMOUNTS = st.integers(1, 9) | st.integers(1, 12_000_000)
FINAL = {state.value for state in transaction_states.FINAL}

_AT = {"parent": "bench", "pose": None}
LAB_FILE: dict[str, Any] = {
    "schema": "labweb.lab/1",
    "name": "Worked at random",
    "time_zone": "UTC",
    "mode": "sim",
    "materials": [{"key": "water", "name": "Water"}, {"key": "ink", "name": "Ink"}],
    "lots": [{"key": "w", "material": "water"}, {"key": "i", "material": "ink"}],
    "resources": [
        {"key": "lab", "name": "Lab", "kind": "lab", "parent": None},
        {"key": "bench", "name": "Bench", "kind": "bench", "parent": "lab"},
        {"key": "tray", "name": "Tray", "kind": "carrier", "parent": "lab"},
        {"key": "archive", "name": "Archive", "kind": "archive", "parent": "lab"},
        {"key": "rack", "name": "Rack", "kind": "tube_rack", "parent": "bench"},
        {"key": "vial", "name": "Vial", "kind": "vial", "parent": "rack"}
        | {"config": {"capacity_ul": 2_000}},
        {"key": "bottle", "name": "Bottle", "kind": "bottle", **_AT}
        | {"config": {"capacity_ul": 50_000, "dead_volume_ul": 100}}
        | {"contents": [{"lot": "w", "amount_ul": 40_000}]},
        {"key": "jug", "name": "Jug", "kind": "vessel", **_AT}
        | {"config": {"capacity_ul": 20_000}}
        | {"contents": [{"lot": "i", "amount_ul": 7_000}, {"lot": "w", "amount_ul": 0.007}]},
        {"key": "flask", "name": "Flask", "kind": "flask", **_AT}
        | {"config": {"capacity_ul": 10_000}},
        {"key": "cup", "name": "Cup", "kind": "vessel", **_AT} | {"config": {"capacity_ul": 5_000}},
    ],
}


@dataclass(frozen=True)
class Live:
    """A transaction under way, and the lab as the edge saw it when it was dispatched."""

    operation: operations.TransferLiquid
    states: decide.Snapshot


class LabMachine(RuleBasedStateMachine):
    """The rules are what people, hosts and faults do; `holds` looks after each."""

    def __init__(self) -> None:
        """Open a savepoint that `teardown` rolls back: every example begins at the import."""
        super().__init__()
        self.block = atomic()
        self.block.__enter__()
        self.lab = Lab.objects.get()
        self.ids = dict(Resource.objects.values_list("key", "id"))
        self.live: dict[UUID, Live] = {}
        self.doubtful: dict[UUID, Live] = {}
        self.drifted: set[UUID] = set()
        self.told: dict[UUID, str] = {}
        self.steps = 0
        held = Holding.objects.values_list("resource_id", "amount_nl")
        self.volume = dict.fromkeys((self.ids[key] for key in VESSELS), 0)
        for vessel, amount in held:
            self.volume[vessel] += amount

    def attempt(self, act: Callable[[], Any]) -> Any:  # noqa: ANN401
        """Try; a refusal is an error of ours, with a code, and leaves everything as it was."""
        before = self.fingerprint()
        code = ""
        try:
            with atomic():
                found = act()
        except LabError as error:
            code, found = error.code, None
        if code:
            assert self.fingerprint() == before, f"{code} changed something"
        return found

    def fingerprint(self) -> tuple[object, ...]:
        held = tuple(Holding.objects.order_by("id").values_list("id", "amount_nl"))
        places = tuple(Resource.objects.order_by("id").values_list("id", "parent", "rev"))
        counts = tuple(model._default_manager.count() for model in (Event, Transaction, Ticket))
        return held, places, counts

    def transfer(self, out_of: str, into: str, amount: int) -> operations.TransferLiquid:
        return operations.TransferLiquid(
            source_id=self.ids[out_of], target_id=self.ids[into], amount_nl=amount
        )

    def by_hand(self, operation: operations.Operation) -> bool:
        act = lambda: services.carry_out(operation, lab=self.lab, actor_id=None)  # type: ignore[arg-type]  # noqa: E731
        return self.attempt(act) is not None

    @rule(out_of=st.sampled_from(VESSELS), into=st.sampled_from(VESSELS), amount=AMOUNTS)
    def dispatch(self, out_of: str, into: str, amount: int) -> None:
        """Lock a transfer for a host."""
        operation = self.transfer(out_of, into, amount)
        touched = operations.touched_ids(operation)
        states = selectors.snapshot(Resource.objects.filter(pk__in=touched))
        act = lambda: services.lock_operation(  # noqa: E731
            operation, lab=self.lab, targets=[], actor_id=None
        )
        row = self.attempt(act)
        if row is not None:
            self.live[row.id] = Live(operation, states)

    @rule(
        out_of=st.sampled_from(VESSELS),
        into=st.sampled_from(VESSELS),
        amount=AMOUNTS,
        kind=KINDS,
        share=st.integers(0, 100),
    )
    def work(self, out_of: str, into: str, amount: int, kind: str, share: int) -> None:
        """Have a host carry a transfer out from end to end."""
        before = {*self.live}
        self.dispatch(out_of, into, amount)
        for key in {*self.live} - before:
            self.report(key, kind, share)

    def pick(self, some: dict[UUID, Live], index: int) -> tuple[UUID, Live]:
        keys = sorted(some)
        return keys[index % len(keys)], some[keys[index % len(keys)]]

    @precondition(lambda self: self.live)
    @rule(index=st.integers(0, 9), state=st.sampled_from(TransactionState))
    def step(self, index: int, state: TransactionState) -> None:
        """Report any state at all: only the next one is taken."""
        key, _ = self.pick(self.live, index)
        if state not in {*transaction_states.FINAL, TransactionState.QUARANTINED}:
            self.attempt(lambda: services.advance(key, state))

    @precondition(lambda self: self.live)
    @rule(index=st.integers(0, 9), kind=KINDS, share=st.integers(0, 100))
    def settle(self, index: int, kind: str, share: int) -> None:
        """Let the host report an end: as asked, a part, nothing, nobody knows, or nonsense."""
        key, _ = self.pick(self.live, index)
        self.report(key, kind, share)

    def report(self, key: UUID, kind: str, share: int) -> None:
        """Settle as the host tells it."""
        live = self.live[key]
        asked = live.operation.amount_nl
        outcome = {
            "half": Outcome(kind=OutcomeKind.PARTIAL, moved_nl=asked * share // 100),
            "none": Outcome(kind=OutcomeKind.PARTIAL, moved_nl=0),
            "unknown": Outcome(kind=OutcomeKind.UNKNOWN),
            "too much": Outcome(kind=OutcomeKind.DONE, moved_nl=10**12),
        }.get(kind, Outcome(kind=OutcomeKind.DONE))
        self.conclude(key, live, outcome, is_drifting=kind == "drift")

    def conclude(
        self, key: UUID, live: Live, outcome: Outcome, *, is_drifting: bool = False
    ) -> None:
        try:
            reported = decide.settle(live.operation, live.states, outcome)
        except LabError:
            reported = decide.settle(
                live.operation, live.states, replace(outcome, kind=OutcomeKind.UNKNOWN)
            )
        plain = reported.to_json()
        if is_drifting and plain["postings"]:
            plain["postings"][0]["amount_nl"] += 1
            self.drifted.add(key)
        settlement = Settlement(outcome=outcome, reported_change=plain)
        change = self.attempt(lambda: services.settle(key, settlement))
        if change is None:
            return
        self.live.pop(key, None)
        self.doubtful.pop(key, None)
        if change.state is TransactionState.QUARANTINED:
            self.doubtful[key] = live
        elif change.state is TransactionState.COMMITTED:
            asked = live.operation.amount_nl
            moved = asked if outcome.moved_nl is None else outcome.moved_nl
            self.volume[live.operation.source_id] -= moved
            self.volume[live.operation.target_id] += moved

    @precondition(lambda self: self.doubtful)
    @rule(
        index=st.integers(0, 9),
        answer=st.sampled_from(["happened", "did not", "partly", "discard"]),
        share=st.integers(1, 99),
    )
    def answer(self, index: int, answer: str, share: int) -> None:
        """Have a person say what happened, or give it up."""
        key, live = self.pick(self.doubtful, index)
        if answer == "discard":
            unknown = Settlement(outcome=Outcome(kind=OutcomeKind.UNKNOWN), keep_quarantined=True)
            services.discard(key, unknown)
            del self.doubtful[key]
            return
        part = live.operation.amount_nl * share // 100
        outcome = {
            "happened": Outcome(kind=OutcomeKind.DONE),
            "did not": Outcome(kind=OutcomeKind.PARTIAL, moved_nl=0),
            "partly": Outcome(kind=OutcomeKind.PARTIAL, moved_nl=part),
        }[answer]
        self.conclude(key, live, outcome)

    @rule(key=st.integers(0, 99))
    def settle_again(self, key: int) -> None:
        """Report on what has ended: refused, whatever is reported."""
        ended = sorted(Transaction.objects.filter(state__in=FINAL).values_list("id", flat=True))
        again = Settlement(outcome=Outcome(kind=OutcomeKind.PARTIAL, moved_nl=0))
        row = ended[key % len(ended)]
        assert self.attempt(lambda: services.settle(row, again)) is None

    @rule(out_of=st.sampled_from(VESSELS), into=st.sampled_from(VESSELS), amount=AMOUNTS)
    def pour(self, out_of: str, into: str, amount: int) -> None:
        """Pour by hand."""
        if self.by_hand(self.transfer(out_of, into, amount)):
            self.volume[self.ids[out_of]] -= amount
            self.volume[self.ids[into]] += amount

    @rule(out_of=st.sampled_from(VESSELS), into=st.sampled_from(VESSELS), amount=AMOUNTS)
    def crash(self, out_of: str, into: str, amount: int) -> None:
        """Die between the last write and the commit."""
        before = self.fingerprint()
        with atomic():
            self.by_hand(self.transfer(out_of, into, amount))
            set_rollback(True)
        assert self.fingerprint() == before

    @rule(vessel=st.sampled_from(VESSELS), amount=AMOUNTS)
    def receive(self, vessel: str, amount: int) -> None:
        """Take a delivery in."""
        operation = operations.Receive(
            lot_id=uuid4(),
            material_id=Lot.objects.all()[0].material_id,
            key=f"lot {Lot.objects.count()}",
            phase=Phase.LIQUID,
            portions=(operations.Portion(resource_id=self.ids[vessel], amount_nl=amount),),
        )
        if self.by_hand(operation):
            self.volume[self.ids[vessel]] += amount

    @rule(vessel=st.sampled_from(VESSELS), amount=st.none() | AMOUNTS)
    def dispose(self, vessel: str, amount: int | None) -> None:
        """Pour away."""
        node = self.ids[vessel]
        if self.by_hand(operations.Dispose(resource_id=node, amount_nl=amount)):
            self.volume[node] -= self.volume[node] if amount is None else amount

    @rule(vessel=st.sampled_from(VESSELS), amount=AMOUNTS)
    def take_stock(self, vessel: str, amount: int) -> None:
        """Measure what a vessel holds; a given-up vessel is free again."""
        node, lot = self.ids[vessel], Lot.objects.order_by("key")[0]
        operation = operations.Correct(
            resource_id=node,
            account=Account.SUSPENSE,
            reason="measured",
            measured_nl={str(lot.id): amount},
        )
        if self.by_hand(operation):
            self.volume[node] = amount
            assert Resource.objects.get(pk=node).quarantined_by is None

    @rule(thing=st.sampled_from(THINGS), place=st.sampled_from(PLACES))
    def carry(self, thing: str, place: str) -> None:
        """Carry a thing, with all in it, to any place: also into itself."""
        row = Resource.objects.get(pk=self.ids[thing])
        assert row.parent_id is not None
        ends = {"from_id": row.parent_id, "to_id": self.ids[place]}
        self.by_hand(operations.TransferResource(resource_id=row.id, **ends))

    @rule(thing=st.sampled_from(VESSELS[2:]), place=st.sampled_from(PLACES))
    def archive_or_restore(self, thing: str, place: str) -> None:
        """Take out of service, or back."""
        row, archive = Resource.objects.get(pk=self.ids[thing]), self.ids["archive"]
        if row.is_archived:
            to = self.ids[place]
            self.by_hand(operations.Restore(resource_id=row.id, from_id=archive, to_id=to))
        else:
            self.by_hand(operations.Delete(resource_id=row.id, archive_id=archive))

    @invariant()
    def holds(self) -> None:
        """Look at everything that is cheap; the rest is looked at when an example ends."""
        parents = dict(Resource.objects.values_list("id", "parent_id"))
        check_tree(parents)
        self.check_states()
        self.check_locks(parents)
        self.check_matter()
        self.check_tickets()

    def check_states(self) -> None:
        """I7: final states stay, and every step is in the table."""
        now = dict(Transaction.objects.values_list("id", "state"))
        for key, state in now.items():
            was = self.told.get(key)
            if was is not None and was != state:
                # An act by hand takes several steps at once; what a host does takes one each.
                allowed = {one.value for one in transaction_states.NEXT[TransactionState(was)]}
                assert state in allowed, f"I7: {was} became {state}"
        assert not self.told.keys() - now.keys(), "I7: a transaction is gone"
        self.told = now

    def check_locks(self, parents: Mapping[UUID, UUID | None]) -> None:
        """I9: what one transaction has alone, no other touches, nor anything in it. I10."""
        locks = ResourceLock.objects.filter(released_at=None)
        alone = dict(locks.filter(mode="X").values_list("resource_id", "transaction_id"))
        assert len(alone) == locks.filter(mode="X").count(), "I9: locked twice"
        for node, owner in alone.items():
            above = parents[node]
            while above is not None:
                assert alone.get(above, owner) == owner, "I9: locked inside a lock"
                above = parents[above]
        owners = {*alone.values()}
        assert owners <= {*self.live, *self.doubtful}, "I10: a lock of nobody"

    def check_matter(self) -> None:
        """I3 and I10: rows, balances and the machine's own count say the same."""
        with atomic(), connection.cursor() as cursor:
            cursor.execute("SET CONSTRAINTS ALL IMMEDIATE")
            cursor.execute("SET CONSTRAINTS ALL DEFERRED")
        held = dict.fromkeys(self.volume, 0)
        for vessel, amount in Holding.objects.values_list("resource_id", "amount_nl"):
            held[vessel] += amount
        assert held == self.volume, "I3: a vessel does not hold what was poured"
        self.steps += 1
        if self.steps % 5 == 0:
            assert ledger_violations(self.lab) == [], "I3 or I10"

    def check_tickets(self) -> None:
        """I12: where edge and server differ, a ticket says so and the vessels are closed."""
        told = {UUID(ticket.detail["transaction_id"]) for ticket in Ticket.objects.all()}
        settled = self.drifted - self.live.keys()
        assert settled <= told, "I12: a difference that nobody was told of"

    def teardown(self) -> None:
        """Look at the chain and the rebuild, and roll everything back."""
        try:
            if connection.connection is not None and not connection.needs_rollback:
                self.check_record()
        finally:
            set_rollback(True)
            self.block.__exit__(None, None, None)

    def check_record(self) -> None:
        """I21: the chain is whole and a change of one row is seen. I22: events rebuild the rows."""
        assert ledger_violations(self.lab) == [], "I3 or I10"
        assert first_broken_event(self.lab) is None, "I21: the chain is broken"
        assert rebuild_differences(self.lab) == [], "I22: rows and events differ"
        with atomic(), connection.cursor() as cursor:
            cursor.execute("SET session_replication_role = replica")
            seq = 1 + len(self.told) % Event.objects.count()
            cursor.execute(
                'UPDATE crutd_event SET body = body || \'{"message": "x"}\' WHERE seq = %s', [seq]
            )
            found = first_broken_event(self.lab)
            cursor.execute("SET session_replication_role = origin")
            set_rollback(True)
        assert found is not None, "I21: an edited event is not seen"
        assert found.subject == str(seq), "I21: another event is blamed"


def check_tree(parents: Mapping[UUID, UUID | None]) -> None:
    """I11: one root, and every way up ends there."""
    assert [*parents.values()].count(None) == 1, "I11: not one root"
    for node in parents:
        above, steps = parents[node], 0
        while above is not None:
            above, steps = parents[above], steps + 1
            assert steps <= len(parents), "I11: a thing stands in itself"
