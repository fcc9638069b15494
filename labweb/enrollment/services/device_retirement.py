"""The end of a device: its host serves it no more, and the inbox may have it back."""

from __future__ import annotations

from collections.abc import Collection
from functools import partial
from typing import Any
from uuid import UUID

from django.db.transaction import on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.domain.errors import LockedError, StateError
from labweb.enrollment import selectors
from labweb.enrollment.models import Candidate, Device
from labweb.enrollment.services.candidates import answer, hold_candidate
from labweb.enrollment.services.devices import check_review
from labweb.enrollment.services.host_messages import tell_host
from labweb.enrollment.services.join_requests import require_admission


def hold_to_retire(device_id: UUID, *, actor: User, reason: str, outcome: str) -> Device:
    """Lock a device with what it was taken up from, and refuse who or what may not be.

    Args:
        device_id: Which.
        actor: Who says so.
        reason: Why.
        outcome: What its candidate becomes; "": back into the inbox, if there is one.

    Raises:
        NotFoundError: There is no such device.
        ForbiddenError: The actor may not admit where it stands; with an outcome, in the lab.
        DefinitionError: No reason was given.
        StateError: It is retired already, or has no candidate for this outcome.
        LockedError: Somebody took something up as it this very moment.
    """
    before = selectors.taken_from(selectors.find_device(device_id))
    if before is not None:
        hold_candidate(before)
    row = selectors.device_for_update(device_id)
    seen = selectors.taken_from(row)
    if seen != before:
        text = f"somebody decides about {row.name} this moment: ask again"
        raise LockedError(text, code="device.busy")
    check_review(row, actor, reason)
    if row.state == Device.State.RETIRED:
        raise StateError(f"{row.name} is retired already", code="device.retired")
    if outcome:
        require_admission(actor, row.lab)
        _check_outcome(row, seen)
    return row


def _check_outcome(row: Device, seen: Candidate | None) -> None:
    if seen is None:
        text = f"nobody took {row.name} up from the inbox, so nothing can go back there: retire it"
        raise StateError(text, code="device.no_candidate")
    if not selectors.is_first_review(row):
        text = f"{row.name} was admitted since it was taken up: suspend or retire it"
        raise StateError(text, code="device.was_admitted")


def end_device(
    row: Device, *, actor: User, reason: str, outcome: str, gone: Collection[UUID]
) -> None:
    """Write the end of a device that is held, and what its candidate becomes.

    Args:
        row: The device; nothing of it acts, and its parts have left the tree.
        actor: Who says so.
        reason: Why.
        outcome: As `hold_to_retire`.
        gone: The parts that left the tree with it.

    Raises:
        StateError: It is rejected, and another device in use has its key.

    Effect:
        None on matter. Its host is told to open a new session, in which it is not served.
    """
    before = row.state
    row.state, row.suspended_for, row.kept_review = Device.State.RETIRED, "", {}
    row.next_driver, row.is_next_ready, row.next_parts = None, False, {}
    row.save()
    detail: dict[str, Any] = {
        "from": before,
        "outcome": outcome,
        "host": row.host.key,
        "nodes": row.nodes,
        "gone": sorted(str(one) for one in gone),
    }
    seen = selectors.taken_from(row)
    if seen is not None:
        detail["candidate_id"] = str(seen.id)
        _give_back(seen, outcome or Candidate.State.NEW, reason, actor)
    account_services.write_audit(
        "device.retire", str(row.id), actor=actor, reason=reason, detail=detail
    )
    on_commit(partial(tell_host, row.host_id, {"type": "edge.renew"}))
    on_commit(partial(feed.publish, "devices", {"device_id": str(row.id)}))


def _give_back(seen: Candidate, state: str, reason: str, actor: User) -> None:
    """Let the inbox have what the device was taken up from, as if that had never been.

    Whoever said that he is this device says it of one that is no more, and the thing in whose
    place this one was taken up has no device either.
    """
    seen.state = Candidate.State.NEW
    answer(seen, state, reason=reason, actor=actor)
    claims = Candidate.objects.filter(key_changed_from=seen)
    claims.update(key_changed_from=None, alone_since_at=None)
    known = seen.key_changed_from
    if known is not None and known.device is None and known.state == Candidate.State.TAKEN_UP:
        known.state = Candidate.State.NEW
        known.save(update_fields=["state"])
