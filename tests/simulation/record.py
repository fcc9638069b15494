"""The record of the simulated server: jobs, attempts, vessels, and what settles them."""

from __future__ import annotations

from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.crutd import operations, settlement, transaction_states
from labweb.domain.crutd.operations import TransferLiquid, Update
from labweb.domain.crutd.settlement import Change, Outcome, OutcomeKind, ResourceState
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.errors import StateError
from labweb.domain.resources.contents_by_lot import add, remove
from labweb.domain.runs.host_actions import host_batch
from labweb.domain.runs.host_link.host_session import HostRecord
from labweb.domain.runs.states import job_states
from labweb.domain.runs.states.job_states import JobState, Mover
from tests.simulation.lab import HOSTS, OWNER, host_id, vessels
from tests.simulation.rows import Attempt, Host, Job, Vessel, Watch


class Record:
    """Jobs, hosts, vessels and locks, as the database keeps them."""

    def __init__(self, watch: Watch) -> None:
        self.watch = watch
        self.jobs: list[Job] = []
        self.by_index: dict[int, Job] = {}
        self.attempts: dict[UUID, Attempt] = {}
        self.vessels = {view.id: Vessel(view) for view in vessels()}
        self.tickets: list[str] = []
        self.batch_count = 0
        self.hosts = {
            host_id(name): Host(
                name=name,
                record=HostRecord(
                    host_id=host_id(name), journal_id=None, acked_seq=0, hash_at_acked="", epoch=0
                ),
            )
            for name in HOSTS
        }

    def host(self, name: str) -> Host:
        return self.hosts[host_id(name)]

    def add_job(self, made: Job) -> None:
        self.jobs.append(made)
        self.by_index[made.index] = made

    def move(self, job_: Job, state: JobState, mover: Mover) -> None:
        job_states.check_step(job_.state, state, mover)
        before, job_.state = job_.state, state
        if state is JobState.RUNNING:
            job_.has_started = True
        self.watch.moved(job_, before, mover)

    def take_stock(self, vessel_id: UUID, nl: int) -> bool:
        """Write down what a person found in a closed vessel, while nothing is open on it."""
        is_open = any(vessel_id in one.targets and one.locks for one in self.attempts.values())
        if is_open:
            return False
        vessel = self.vessels[vessel_id]
        lot = f"lot {OWNER[vessel_id]}"
        view = msgspec.structs.replace(
            vessel.view, contents={lot: nl} if nl else {}, rev=vessel.view.rev + 1
        )
        self.vessels[vessel_id] = Vessel(view)
        return True

    def snapshot(self, operation: TransferLiquid | Update) -> dict[UUID, ResourceState]:
        found = {}
        for vessel_id in operations.touched_ids(operation):
            vessel = self.vessels[vessel_id]
            view = vessel.view
            found[vessel_id] = ResourceState(
                id=view.id,
                name=view.name,
                kind=view.kind,
                contents=dict(view.contents),  # type: ignore[arg-type]
                capacity_nl=view.capacity_nl,
                quarantined_by=vessel.quarantined_by,
            )
        return found

    def _settle(
        self,
        attempt: Attempt,
        outcome: Outcome,
        reported: dict[str, Any] | None,
        body: Any,  # noqa: ANN401 - an event's
    ) -> None:
        operation = attempt.job.operation
        try:
            change = settlement.settle(operation, self.snapshot(operation), outcome)
        except StateError as error:
            if attempt.transaction is TransactionState.QUARANTINED:
                raise
            self.tickets.append(error.code)
            change = settlement.settle(operation, {}, Outcome(kind=OutcomeKind.UNKNOWN))
        if reported is not None and reported != change.to_json():
            self.tickets.append("reconcile.drift")
            for vessel_id in operations.touched_ids(operation):
                self.vessels[vessel_id].quarantined_by = str(attempt.id)
        transaction_states.check_step(attempt.transaction, change.state)
        self._write(attempt, change, (body or {}).get("revs") or {})
        self._close(attempt, change.state, is_freed=True)

    def _write(self, attempt: Attempt, change: Change, revs: dict[str, int]) -> None:
        touched = set(change.quarantined)
        for posting in change.postings:
            parts = {posting.lot: posting.amount_nl}
            for account, pour in ((posting.debit, remove), (posting.credit, add)):
                vessel = self.vessels[UUID(account)]
                left = pour(vessel.view.contents, parts)  # type: ignore[arg-type]
                vessel.view = msgspec.structs.replace(vessel.view, contents=left)
                touched.add(UUID(account))
        for vessel_id, data in change.data.items():
            vessel = self.vessels[vessel_id]
            vessel.view = msgspec.structs.replace(vessel.view, data={**vessel.view.data, **data})
            touched.add(vessel_id)
        for vessel_id in change.quarantined:
            # The first cause stays: its answer, or a person's measure, opens the vessel.
            if self.vessels[vessel_id].quarantined_by is None:
                self.vessels[vessel_id].quarantined_by = str(attempt.id)
        self._set_revs(revs or {str(i): self.vessels[i].view.rev + 1 for i in touched})

    def _set_revs(self, revs: dict[str, int]) -> None:
        for key, rev in revs.items():
            vessel = self.vessels[UUID(key)]
            vessel.view = msgspec.structs.replace(vessel.view, rev=rev)

    def _close(self, attempt: Attempt, state: TransactionState, *, is_freed: bool) -> None:
        was_quarantined = attempt.transaction is TransactionState.QUARANTINED
        attempt.transaction = state
        if state not in transaction_states.FINAL:
            return
        self._pass_on(attempt)
        if was_quarantined and is_freed:
            for vessel in self.vessels.values():
                if vessel.quarantined_by == str(attempt.id):
                    vessel.quarantined_by = None

    def _pass_on(self, attempt: Attempt) -> None:
        """Release the locks of a try, or hand them on within its batch."""
        held, attempt.locks = attempt.locks, ()
        members = [
            one
            for one in self.attempts.values()
            if one.batch_id is not None
            and one.batch_id == attempt.batch_id
            and one is not attempt
            and one.transaction not in transaction_states.FINAL
        ]
        claims = {one.id: one.needed for one in members}
        for resource, heir in host_batch.heirs([lock.resource_id for lock in held], claims).items():
            if heir is not None:
                lock = next(one for one in held if one.resource_id == resource)
                self.attempts[heir].locks += (lock,)

    def _discard(self, attempt: Attempt, revs: dict[str, int]) -> None:
        transaction_states.check_step(attempt.transaction, TransactionState.ROLLED_BACK)
        data = settlement.given_up(attempt.job.operation)
        self._write(attempt, Change(state=TransactionState.ROLLED_BACK, data=data), revs)
        self._close(attempt, TransactionState.ROLLED_BACK, is_freed=False)
