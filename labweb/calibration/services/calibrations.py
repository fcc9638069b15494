"""Calibrate a device: a run that measures, a result that is judged, a person who accepts it."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta
from functools import partial
from hashlib import sha256
from uuid import UUID

import msgspec
from django.db.models import Max
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.calibration import selectors
from labweb.calibration.models import Calibration
from labweb.calibration.services import (
    gravimetric_calibration,
    ph_calibration,
    temperature_calibration,
)
from labweb.calibration.services.calibration_runs import calibration_runs
from labweb.common import feed
from labweb.common.clock import now
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.calibration.calibration_order import (
    Order,
    PhOrder,
    VolumeOrder,
    check_certificates,
)
from labweb.domain.calibration.calibration_result import CalibrationOutcome
from labweb.domain.calibration.correction import CalibrationQuantity
from labweb.domain.canonical_json import canonical
from labweb.domain.errors import (
    DefinitionError,
    Finding,
    PreconditionError,
    StateError,
)
from labweb.domain.runs.states.job_states import RunState
from labweb.enrollment import selectors as enrollment_selectors
from labweb.resources import selectors as resource_selectors

LONGEST_TEXT = 2000

RULE = "A calibration needs a second person"

_JUDGES: dict[str, Callable[[Calibration], tuple[list[Finding], CalibrationOutcome | None]]] = {
    CalibrationQuantity.VOLUME.value: gravimetric_calibration.judged,
    CalibrationQuantity.PH.value: ph_calibration.judged,
    CalibrationQuantity.TEMPERATURE.value: temperature_calibration.judged,
}


@atomic
def begin_calibration(device_id: UUID, order: Order, *, actor: User) -> Calibration:
    """Draw the workflow that calibrates a device, and start it in the actor's name.

    Raises:
        ForbiddenError: The actor may not run things on the device.
        PreconditionError: Something speaks against it; `findings` list everything.
        StateError: One of this quantity is under way already.
        LabError: As `start_run`: the lab cannot carry it out, or the actor may not.

    Effect:
        The run moves water or buffers, or heats, as soon as the dispatcher sends its first job.
    """
    device = enrollment_selectors.device_for_update(device_id)
    nodes = enrollment_selectors.node_ids(device)
    resource_selectors.require(actor, Permission.RUN, nodes)
    runs = calibration_runs()
    view = runs.view_of_lab(device.lab)
    busy = Calibration.objects.filter(
        device=device, quantity=order.quantity.value, state=Calibration.State.MEASURING
    )
    if busy.exists():
        text = f"a calibration of {order.quantity.value} of {device.name} is under way"
        raise StateError(text, code="calibration.under_way")
    if isinstance(order, VolumeOrder):
        document, facts = gravimetric_calibration.drawn(view, device, order)
    elif isinstance(order, PhOrder):
        document, facts = ph_calibration.drawn(view, device, order)
    else:
        document, facts = temperature_calibration.drawn(view, device, order)
    run_id = runs.start_measurement(device.lab, document, actor=actor)
    known = Calibration.objects.filter(device=device, quantity=order.quantity.value)
    row = Calibration.objects.create(
        device=device,
        quantity=order.quantity.value,
        number=(known.aggregate(Max("number"))["number__max"] or 0) + 1,
        run_id=run_id,
        order=msgspec.to_builtins(order) | facts,
        fingerprint=selectors.fingerprint_of(device),
        valid_days=order.valid_days,
        made_by=actor,
        made_at=now(),
    )
    account_services.write_audit(
        "calibration.begin", str(row.id), actor=actor, detail={"device": str(device.id)}
    )
    on_commit(partial(_announce, device.id))
    return row


def judge_ended() -> int:
    """Judge every calibration whose run has ended; return how many were."""
    ids = list(selectors.ended_calibrations().values_list("pk", flat=True)[:20])
    for pk in ids:
        _judge_one(pk)
    return len(ids)


@atomic
def _judge_one(calibration_id: UUID) -> None:
    row = selectors.calibration_for_update(calibration_id)
    if row.state != Calibration.State.MEASURING:
        return
    found, result = _judged(row)
    row.findings = [one.to_json() for one in found]
    row.result = None if result is None else msgspec.to_builtins(result)
    row.measured_at = row.run.ended_at or now()
    row.state = Calibration.State.FAILED if result is None else Calibration.State.AWAITING
    row.save(update_fields=["findings", "result", "points", "measured_at", "state"])
    if result is not None:
        ask_about(row)
    on_commit(partial(_announce, row.device_id))


def _judged(row: Calibration) -> tuple[list[Finding], CalibrationOutcome | None]:
    if row.run.state != RunState.COMPLETE.value:
        text = f"run {row.run.number} ended before all was measured"
        return [Finding("calibration.incomplete", text, str(row.run_id))], None
    found, result = _JUDGES[row.quantity](row)
    measured_at = row.run.ended_at or now()
    return [
        *check_certificates(selectors.references_of(row), on=measured_at.date()),
        *found,
    ], result


def ask_about(row: Calibration) -> None:
    """Put a result into the queue of what waits for a second person, until its own due date."""
    facts = {"order": row.order, "points": row.points, "result": row.result}
    measured_at = row.measured_at or now()
    calibration_runs().ask_person(
        row.id,
        lab=row.device.lab,
        title=f"Calibration {row.number} of {row.quantity} of {row.device.name}",
        digest=sha256(canonical(facts)).hexdigest(),
        rule=RULE,
        asked_by=row.made_by,
        expires_at=measured_at + timedelta(days=row.valid_days),
    )


@atomic
def decide_calibration(
    calibration_id: UUID, *, actor: User, is_accepted: bool, comment: str
) -> Calibration:
    """Accept or reject a result; what is accepted corrects from the next plan on.

    The decision is one of those about requests: the same rights, a second person, a signed word.

    Raises:
        ForbiddenError: The actor measured it, or may not decide here.
        StateError: It waits for nobody, or for nobody any more.
        PreconditionError: It has findings, which nobody accepts away; or the device is no longer
            what was measured.

    Effect:
        None on matter. Plans that are made before keep the numbers that they were made with.
    """
    row = selectors.calibration_for_update(calibration_id)
    runs = calibration_runs()
    runs.require_deciding(actor, row.device.lab)
    if row.state != Calibration.State.AWAITING or row.measured_at is None:
        raise StateError(f"this calibration is {row.state}", code="calibration.not_waiting")
    runs.decide_request(row.id, actor=actor, is_approved=is_accepted, comment=comment)
    if is_accepted:
        _refuse_unsound(row)
        row.expires_at = row.measured_at + timedelta(days=row.valid_days)
    row.state = Calibration.State.ACCEPTED if is_accepted else Calibration.State.REJECTED
    row.decided_by, row.decided_at, row.comment = actor, now(), _text(comment)
    row.save(update_fields=["state", "decided_by", "decided_at", "comment", "expires_at"])
    _write(row, "calibration.accept" if is_accepted else "calibration.reject", actor, comment)
    return row


@atomic
def reject_unanswered(calibration_id: UUID, *, reason: str) -> bool:
    """Reject a result about which nobody answered in time.

    Returns:
        False: somebody answers at this moment, and goes first; nothing was written.
    """
    rows = Calibration.objects.filter(pk=calibration_id).select_for_update(
        skip_locked=True, no_key=True
    )
    row = rows.first()
    if row is None:
        return False
    row.state, row.comment = Calibration.State.REJECTED, reason
    row.save(update_fields=["state", "comment"])
    account_services.write_audit("calibration.reject", str(row.id), actor=None, reason=reason)
    return True


def _refuse_unsound(row: Calibration) -> None:
    findings = [
        Finding(one["code"], one["message"], one.get("subject", "")) for one in row.findings
    ]
    if row.fingerprint != selectors.fingerprint_of(row.device):
        text = f"{row.device.name} was changed since it was measured: measure it again"
        findings.append(Finding("calibration.changed", text, str(row.device_id)))
    if findings:
        first = findings[0]
        raise PreconditionError(first.message, code=first.code, findings=findings)


@atomic
def withdraw_calibration(calibration_id: UUID, *, actor: User, reason: str) -> Calibration:
    """Let an accepted calibration be relied on no more; the one before does not come back.

    Raises:
        ForbiddenError: The actor may not decide here.
        DefinitionError: The reason is missing.
        StateError: It was never accepted, or is withdrawn.

    Effect:
        None on matter. From the next plan on nothing is corrected by it, and hosts are asked to
        give back what they have not begun with its numbers.
    """
    row = selectors.calibration_for_update(calibration_id)
    _require(row, actor)
    if not reason.strip():
        raise DefinitionError("say why it is withdrawn", code="calibration.reason")
    if row.state != Calibration.State.ACCEPTED:
        raise StateError(f"this calibration is {row.state}", code="calibration.not_accepted")
    row.state = Calibration.State.WITHDRAWN
    row.withdrawn_by, row.withdrawn_at = actor, now()
    row.withdrawn_because = _text(reason)
    row.save(update_fields=["state", "withdrawn_by", "withdrawn_at", "withdrawn_because"])
    calibration_runs().recall_corrected(row.id, issued_by=str(actor.pk))
    _write(row, "calibration.withdraw", actor, reason)
    return row


def _require(row: Calibration, actor: User) -> None:
    nodes = enrollment_selectors.node_ids(row.device)
    resource_selectors.require(actor, Permission.DECIDE, nodes)


def _text(text: str) -> str:
    if len(text) > LONGEST_TEXT:
        raise DefinitionError(f"at most {LONGEST_TEXT} characters", code="calibration.reason")
    return text.strip()


def _write(row: Calibration, action: str, actor: User, reason: str) -> None:
    account_services.write_audit(action, str(row.id), actor=actor, reason=reason)
    on_commit(partial(_announce, row.device_id))


def _announce(device_id: UUID) -> None:
    feed.publish("devices", {"device_id": str(device_id)})
