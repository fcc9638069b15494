"""Carry a vessel from one host's hands into another's: asked, released, found, received."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any
from uuid import UUID

import msgspec
from django.db.models import Q
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.common.clock import happened_at, new_id, now
from labweb.common.dispatcher_wakeup import wake_dispatcher
from labweb.crutd import selectors as crutd_selectors
from labweb.crutd import services as crutd_services
from labweb.crutd.selectors import Transaction
from labweb.crutd.services import Settlement
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd.operations import TransferResource
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.domain.errors import (
    DefinitionError,
    NotFoundError,
    PreconditionError,
    StateError,
)
from labweb.domain.messages.commands import ReceiveCommand, Release, ResourceView
from labweb.domain.messages.events import EdgeEvent
from labweb.domain.runs.exclusive_use import resource_custody as rules
from labweb.domain.runs.exclusive_use.resource_custody import CustodyState
from labweb.enrollment.selectors import EdgeHost
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Resource
from labweb.runs import selectors
from labweb.runs.models import Custody, Job, Outbox
from labweb.runs.services.execution import dispatch
from labweb.runs.services.execution.job_states import announce, hold_job
from labweb.runs.services.host_tickets import doubt

KINDS = frozenset({"released", "kept", "received"})
"""Events of hosts that speak of custody."""


@atomic
def hand_over(resource_id: UUID, place_id: UUID, *, actor: User, note: str) -> Custody:
    """Begin to move a vessel to a place that belongs to another host.

    Raises:
        NotFoundError: There is no such vessel or place.
        ForbiddenError: The actor may not run things on one of the two.
        DefinitionError: No note, or both belong to one host: a plain transfer does then.
        LockedError, PreconditionError: It is in use, or may not go there.

    Effect:
        Nothing moves yet: its host is asked to let it go. Locks hold until it has arrived.
    """
    resource_selectors.require(actor, Permission.RUN, [resource_id, place_id])
    rows = {row.id: row for row in resource_selectors.rows([resource_id, place_id])}
    row = rows.get(resource_id)
    if row is None or place_id not in rows or row.parent_id is None:
        raise NotFoundError("no such vessel or place", code="resource.not_found")
    operation = TransferResource(resource_id=resource_id, from_id=row.parent_id, to_id=place_id)
    hosts = selectors.hosts_between(row, operation)
    if hosts is None:
        text = "vessel and place do not belong to two hosts: a plain transfer does"
        raise DefinitionError(text, code="custody.same_host")
    return _ask(row, operation, hosts, actor=actor, note=note)


@atomic
def begin_transfer(
    operation: TransferResource, *, actor: User, note: str, run_id: UUID | None = None
) -> Custody | None:
    """Begin a transfer that a person tells of, where two hosts have to agree on it.

    Returns:
        None when no two hosts do: a plain transfer writes it down at once.

    Raises:
        DefinitionError: No note.
        LockedError, PreconditionError: It is in use, or may not go there.

    Effect:
        As `hand_over`.
    """
    row = resource_selectors.find_resource(operation.resource_id)
    hosts = selectors.hosts_between(row, operation)
    if hosts is None:
        return None
    return _ask(row, operation, hosts, actor=actor, note=note, run_id=run_id)


def _ask(
    row: Resource,
    operation: TransferResource,
    hosts: tuple[EdgeHost, EdgeHost],
    *,
    actor: User,
    note: str,
    run_id: UUID | None = None,
) -> Custody:
    if not note.strip():
        raise DefinitionError("say why it is moved: the note is empty", code="run.note_missing")
    transaction = crutd_services.lock_operation(
        operation, lab=row.lab, targets=[row.id], actor_id=actor.pk, run_id=run_id
    )
    made = begin(row, hosts, transaction, actor=actor)
    account_services.write_audit("custody.ask", str(row.id), actor=actor, reason=note)
    return made


def begin(
    row: Resource,
    hosts: tuple[EdgeHost, EdgeHost],
    transaction: Transaction,
    *,
    actor: User,
    job: Job | None = None,
) -> Custody:
    """Ask the host that has a thing to let it go, with all that stands in it.

    Args:
        row: The thing.
        hosts: Who has it, and who takes it over.
        transaction: Holds the locks of the move until it has ended.
        actor: In whose name.
        job: Job that carries it, which needs nobody to say that it arrived.
    """
    owner, target = hosts
    inside = resource_selectors.descendants([row.id]) - {row.id}
    rows = [row, *resource_selectors.rows(inside)]
    states = crutd_selectors.snapshot(rows)
    view, *parts = [dispatch.view_of(one, states[one.id]) for one in rows]
    made = Custody.objects.create(
        resource_id=row.id,
        state=CustodyState.LEAVING.value,
        owner=owner,
        origin=owner,
        target=target,
        place_id=UUID(transaction.operation["to_id"]),
        transfer_id=new_id(),
        transaction_id=transaction.pk,
        parts=msgspec.to_builtins(parts),
        job=job,
        asked_by=actor,
        at=now(),
    )
    command = Release(
        host_id=owner.id,
        epoch=owner.epoch,
        dseq=owner.last_dseq,
        transfer_id=_transfer_id(made),
        resource_id=row.id,
        view=view,
        parts=parts,
        issued_by=str(actor.pk),
    )
    _send(owner, command, made)
    _tell(made)
    return made


@atomic
def confirm_arrival(custody_id: UUID, *, actor: User) -> Custody:
    """Say that a vessel in transit is at its place, so that its new host takes it over.

    Raises:
        NotFoundError: There is no such move.
        StateError: It is not in transit, or its arrival was told before.
        ForbiddenError: The actor may not run things on it.
    """
    made = (
        Custody.objects.select_for_update(of=("self",), no_key=True).filter(pk=custody_id).first()
    )
    if made is None:
        raise NotFoundError(f"no move {custody_id}", code="custody.not_found")
    resource_selectors.require(actor, Permission.RUN, [made.resource_id])
    if made.state != CustodyState.IN_TRANSIT.value or made.target is None or made.view is None:
        raise StateError("it is not in transit", code="custody.not_in_transit")
    if selectors.is_told(made):
        raise StateError("its new host was told already", code="custody.told")
    _send_receive(made, made.view, made.target, issued_by=str(actor.pk))
    account_services.write_audit("custody.arrived", str(made.resource_id), actor=actor)
    _tell(made)
    return made


def _send_receive(made: Custody, told: dict[str, Any], target: EdgeHost, *, issued_by: str) -> None:
    view = {**told, "parent_id": str(made.place_id)}
    command = ReceiveCommand(
        host_id=target.id,
        epoch=target.epoch,
        dseq=target.last_dseq,
        transfer_id=_transfer_id(made),
        view=msgspec.convert(view, ResourceView),
        parts=msgspec.convert(made.parts, list[ResourceView]),
        issued_by=issued_by,
    )
    _send(target, command, made)


def _send(host: EdgeHost, command: Release | ReceiveCommand, made: Custody) -> None:
    body = msgspec.to_builtins(command)
    Outbox.objects.create(
        host=host, action_id=_transfer_id(made), kind=body["t"], body=body, at=now()
    )
    wake_dispatcher()


def _transfer_id(made: Custody) -> UUID:
    if made.transfer_id is None:
        raise StateError("this move has no name", code="custody.not_found")
    return made.transfer_id


def _tell(made: Custody) -> None:
    for host_id in {made.owner_id, made.target_id} - {None}:
        on_commit(partial(feed.publish, "hosts", {"host_id": str(host_id)}))
    if made.job is not None:
        on_commit(partial(announce, made.job.run_id, made.job_id))


def take_custody_event(host: EdgeHost, event: EdgeEvent) -> None:
    """Apply what a host says about a vessel that leaves it or comes to it.

    What contradicts the record opens a ticket and closes the vessel until a person has
    looked; the host's log is not doubted for it.
    """
    transfer_id = UUID(str(event.body["transfer_id"]))
    rows = Custody.objects.select_for_update(of=("self",), no_key=True)
    made = rows.filter(transfer_id=transfer_id, ended_at__isnull=True).first()
    if made is None:
        _conflict(host, None, "it speaks of a move that is over or never was", event)
        return
    steps: dict[str, Callable[[EdgeHost, Custody, EdgeEvent], None]] = {
        "released": _released,
        "kept": _kept,
        "received": _received,
    }
    try:
        with atomic():
            steps[event.kind](host, made, event)
    except StateError as error:
        _conflict(host, made, error.message, event)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        made.refresh_from_db()
        _conflict(host, made, f"its word makes no sense ({error})", event)
    _tell(made)


def _record(made: Custody) -> rules.ResourceCustody:
    return rules.ResourceCustody(
        resource_id=made.resource_id,
        state=CustodyState(made.state),
        owner=made.owner_id,
        transfer_id=made.transfer_id,
        target=made.target_id,
    )


def _released(host: EdgeHost, made: Custody, event: EdgeEvent) -> None:
    view = msgspec.convert(event.body["view"], ResourceView)
    after = rules.after_released(
        _record(made), host=host.id, transfer_id=_transfer_id(made), view=view
    )
    newer = {part["id"]: part for part in event.body.get("parts", [])}
    made.parts = [newer.get(part["id"], part) for part in made.parts]
    made.state, made.owner, made.view = after.state.value, None, event.body["view"]
    made.released_at = happened_at()
    made.save(update_fields=["state", "owner", "view", "parts", "released_at"])
    dispatch.settle_outbox(_transfer_id(made), ["release"])
    if made.job_id is not None and made.target is not None:
        told = event.body["view"]
        _send_receive(made, told, made.target, issued_by=str(made.asked_by_id))


def _kept(host: EdgeHost, made: Custody, event: EdgeEvent) -> None:
    after = rules.after_kept(_record(made), host=host.id, transfer_id=_transfer_id(made))
    if after.state is not CustodyState.OWNED or made.transaction_id is None:
        raise StateError(f"it keeps what it does not own ({event.seq})", code="custody.not_owner")
    dispatch.settle_outbox(_transfer_id(made), ["release"])
    nothing = Outcome(kind=OutcomeKind.PARTIAL, moved_nl=0)
    text = f"{host.name} keeps it: something uses it there"
    crutd_services.settle(
        made.transaction_id, Settlement(outcome=nothing, code="custody.in_use", message=text)
    )
    _end(made, host)
    if made.job_id is not None:
        _stop_for(made, made.job_id, text)


def _stop_for(made: Custody, job_id: UUID, text: str) -> None:
    """Have a person look at a job whose thing its host keeps, before or after it acts."""
    hold_job(job_id, PreconditionError(text, code="custody.in_use"))
    detail = {"job_id": str(job_id), "resource_id": str(made.resource_id)}
    crutd_services.open_ticket(made.resource.lab, "custody.in_use", text, detail)


def _received(host: EdgeHost, made: Custody, event: EdgeEvent) -> None:
    rules.after_received(_record(made), host=host.id, transfer_id=_transfer_id(made))
    if made.transaction_id is None:
        raise StateError("this move has no transaction", code="custody.not_target")
    dispatch.settle_outbox(_transfer_id(made), ["receive"])
    crutd_services.settle(
        made.transaction_id,
        Settlement(
            outcome=Outcome(kind=OutcomeKind.DONE),
            verification="assumed",
            revs={made.resource_id: int(event.body["rev"])},
        ),
    )
    _end(made, host)


def _end(made: Custody, owner: EdgeHost) -> None:
    made.state, made.owner, made.ended_at = CustodyState.OWNED.value, owner, happened_at()
    made.save(update_fields=["state", "owner", "ended_at"])


def _conflict(host: EdgeHost, made: Custody | None, why: str, event: EdgeEvent) -> None:
    detail = {"kind": event.kind, "transfer_id": str(event.body["transfer_id"]), "body": event.body}
    text = f"{host.name} and the record differ about a vessel on its way: {why}"
    if made is None:
        doubt(host, "custody.conflict", text, detail, "transfer_id")
        return
    detail["host_id"] = str(host.id)
    crutd_services.open_ticket(host.lab, "custody.conflict", text, detail)
    _lose(made)


def lose_moves_of(host: EdgeHost) -> None:
    """Close the vessels on their way from or to a host whose log can tell nothing of them."""
    rows = Custody.objects.select_for_update(of=("self",), no_key=True).filter(
        ended_at__isnull=True
    )
    for made in rows.filter(Q(owner=host) | Q(target=host)):
        text = "nobody knows in whose hands it is: find it, and take stock of it"
        detail = {"host_id": str(host.id), "resource_id": str(made.resource_id)}
        crutd_services.open_ticket(host.lab, "custody.conflict", text, detail)
        _lose(made)


def _lose(made: Custody) -> None:
    """End a move with its vessel closed: a person finds it and takes stock of it."""
    if made.transaction_id is not None:
        nothing = Outcome(kind=OutcomeKind.PARTIAL, moved_nl=0)
        settlement = Settlement(
            outcome=nothing, code="custody.conflict", closes=frozenset({made.resource_id})
        )
        crutd_services.settle(made.transaction_id, settlement)
    dispatch.settle_outbox(_transfer_id(made), ["release", "receive"])
    made.ended_at = now()
    made.save(update_fields=["ended_at"])
