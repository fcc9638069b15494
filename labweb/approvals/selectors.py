"""Reads of policies, requests and decisions."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from datetime import timedelta
from uuid import UUID

import msgspec
from django.db.models import QuerySet, UUIDField

from labweb.accounts.selectors.hash_chains import DECISIONS, first_broken_head
from labweb.approvals.models import ApprovalRequest as ApprovalRequest
from labweb.approvals.models import Decision, SimulatorOffer
from labweb.approvals.models import Policy as Policy
from labweb.approvals.models import Tryout as Tryout
from labweb.approvals.models import TryoutAct as TryoutAct
from labweb.common.clock import now
from labweb.common.database.prepared_queries import Given, Prepared
from labweb.domain.canonical_json import canonical
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.enrollment.driver_tryout import (
    SILENT_S,
    STARTS_S,
    AnsweredWish,
    Tried,
    fitting,
    tried,
)
from labweb.domain.errors import Finding, NotFoundError
from labweb.domain.messages.chain_heads import Countersigned
from labweb.domain.messages.driver_tryouts import SimulatedModel
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.enrollment.selectors import DriverVersion, EdgeHost
from labweb.resources.selectors import Lab


def active_policies(lab: Lab) -> QuerySet[Policy]:
    """Policies that are in force."""
    return Policy.objects.filter(lab=lab, is_active=True).order_by("name")


RULES = Prepared(
    lambda: Policy.objects.filter(lab_id=Given("lab", UUIDField()), is_active=True).order_by("name")
)
"""The policies of a lab that are in force."""


def requests_of(lab: Lab) -> QuerySet[ApprovalRequest]:
    """Requests, newest first, with askers and decisions."""
    return ApprovalRequest.objects.filter(lab=lab).select_related("asked_by", "decision__actor")


def no_request(request_id: UUID) -> NotFoundError:
    """Return what is said of a request that there is not, or not for who asks."""
    return NotFoundError(f"no request {request_id}", code="approval.not_found")


def find_request(request_id: UUID) -> ApprovalRequest:
    """Return a request.

    Raises:
        NotFoundError: There is none.
    """
    row = (
        ApprovalRequest.objects.filter(pk=request_id)
        .select_related("asked_by", "decision__actor", "lab")
        .first()
    )
    if row is None:
        raise no_request(request_id)
    return row


def approved_of_run(run_id: UUID) -> frozenset[str]:
    """Return the names of the policies for which a person has approved a run."""
    approved = ApprovalRequest.State.APPROVED
    rows = ApprovalRequest.objects.filter(run_id=run_id, state=approved)
    return frozenset(
        name for policies in rows.values_list("policies", flat=True) for name in policies
    )


def decision_hash(prev: str, row: Decision) -> str:
    """Return the SHA-256 that binds a decision to all before it."""
    fields = {
        "prev": prev,
        "seq": row.seq,
        "request": str(row.request_id),
        "actor": str(row.actor_id),
        "printed_name": row.printed_name,
        "is_approved": row.is_approved,
        "meaning": row.meaning,
        "comment": row.comment,
        "plan_digest": row.plan_digest,
        "at": row.at.isoformat(),
    }
    return hashlib.sha256(canonical(fields)).hexdigest()


def end_of_decisions() -> tuple[int, str] | None:
    """Return number and hash of the last decision; None: there is none."""
    row = Decision.objects.order_by("-seq").values_list("seq", "hash").first()
    return None if row is None else (row[0], row[1])


def first_broken_decision(kept: Sequence[Countersigned] = ()) -> Finding | None:
    """Return the first decision that is not as it was written, or the first head that fails.

    Args:
        kept: Heads that were kept outside of this server.
    """
    seq, prev = 0, ""
    for row in Decision.objects.order_by("seq").iterator(chunk_size=2000):
        if row.seq != seq + 1 or row.prev_hash != prev:
            text = f"decision {seq + 1} is missing, or was exchanged: decision {row.seq} follows"
            return Finding("decisions.missing", text, str(seq + 1))
        if decision_hash(prev, row) != row.hash:
            text = f"decision {row.seq} was edited: it does not fit its own hash"
            return Finding("decisions.edited", text, str(row.seq))
        seq, prev = row.seq, row.hash
    rows = Decision.objects.all()
    return first_broken_head(
        DECISIONS,
        lambda number: rows.filter(seq=number).values_list("hash", flat=True).first(),
        kept,
    )


def run_of(row: ApprovalRequest) -> UUID:
    """Return the run that a request is about.

    Raises:
        NotFoundError: It is about a driver or a calibration.
    """
    if row.run_id is None:
        raise NotFoundError(f"{row.title} is about no run", code="approval.not_found")
    return row.run_id


def request_about_driver(driver_id: UUID) -> ApprovalRequest:
    """Return the newest request about a driver version.

    Raises:
        NotFoundError: Nobody was asked about it.
    """
    row = newest_about_driver(driver_id)
    if row is None:
        raise NotFoundError(f"nobody was asked about {driver_id}", code="approval.not_found")
    return row


def newest_about_driver(driver_id: UUID) -> ApprovalRequest | None:
    """Return the newest request about a driver version with its decision, if it has one."""
    rows = ApprovalRequest.objects.filter(driver_id=driver_id).select_related("decision")
    return rows.order_by("-asked_at").first()


def about_calibration(calibration_id: UUID) -> ApprovalRequest:
    """Return the request about the result of a calibration.

    Raises:
        NotFoundError: Nobody was asked about it.
    """
    row = ApprovalRequest.objects.filter(calibration_id=calibration_id).first()
    if row is None:
        raise NotFoundError(f"nobody was asked about {calibration_id}", code="approval.not_found")
    return row


def open_about_drivers(lab: Lab) -> QuerySet[ApprovalRequest]:
    """Open requests about driver versions that can still be answered, with who asked."""
    rows = ApprovalRequest.objects.filter(lab=lab, state="open", driver_id__isnull=False)
    rows = rows.filter(expires_at__gt=now())
    return rows.select_related("asked_by").order_by("asked_at")


OF_RUN = Prepared(
    lambda: ApprovalRequest.objects.filter(run_id=Given("run", UUIDField())).order_by("-asked_at")[
        :1
    ]
)
"""The newest request of a run."""


# --- drivers on trial ---

MOST_ACTS_SHOWN = 100
"""Wishes of one tryout that are shown."""


def offers() -> list[SimulatorOffer]:
    """Return what the hosts that are here and now connected can simulate."""
    rows = SimulatorOffer.objects.filter(
        host__state=SessionState.ONLINE.value, host__suspended_at__isnull=True
    )
    return [row for row in rows.select_related("host").order_by("host__key") if is_current(row)]


def is_current(row: SimulatorOffer) -> bool:
    """Say whether an offer was made in the session that its host has now."""
    return row.epoch == row.host.epoch


def offer_of(host: EdgeHost) -> SimulatorOffer | None:
    """Return what a host offers in its present session, or None."""
    row = SimulatorOffer.objects.filter(host=host, epoch=host.epoch).select_related("host").first()
    return row if row is not None and row.host.state == SessionState.ONLINE.value else None


def models_for(row: SimulatorOffer, version: DriverVersion) -> list[SimulatedModel]:
    """Return the models of an offer that a version can be connected to."""
    models = msgspec.convert(row.models_offered, list[SimulatedModel])
    return fitting(msgspec.convert(version.spec, DriverSpec), models)


def tryouts_of(version: DriverVersion) -> QuerySet[Tryout]:
    """Tryouts of a version, the newest first."""
    rows = Tryout.objects.filter(version=version).select_related("host", "begun_by")
    return rows.defer("wire")


def find_tryout(tryout_id: UUID) -> Tryout:
    """Return a tryout with its version.

    Raises:
        NotFoundError: There is none.
    """
    row = Tryout.objects.filter(pk=tryout_id).select_related("version", "host", "begun_by").first()
    if row is None:
        raise NotFoundError(f"no tryout {tryout_id}", code="tryout.not_found")
    return row


def tryout_for_update(tryout_id: UUID) -> Tryout:
    """Lock and return a tryout.

    Raises:
        NotFoundError: There is none.
    """
    find_tryout(tryout_id)
    return (
        Tryout.objects.select_for_update(of=("self",), no_key=True)
        .select_related("version")
        .get(pk=tryout_id)
    )


def acts_of(row: Tryout) -> list[TryoutAct]:
    """What was asked of a tryout last, in order."""
    return list(row.acts.order_by("-number")[:MOST_ACTS_SHOWN])[::-1]


def is_over(row: Tryout) -> bool:
    """Say whether a tryout has ended, or its host has been silent for too long."""
    if row.state == Tryout.State.ENDED:
        return True
    patience_s = STARTS_S if row.state == Tryout.State.STARTING else SILENT_S
    return row.heard_at < now() - timedelta(seconds=patience_s)


def going_on(host: EdgeHost) -> list[Tryout]:
    """Return the tryouts that a host runs or is to run."""
    rows = Tryout.objects.filter(host=host).exclude(state=Tryout.State.ENDED)
    return [row for row in rows.defer("wire") if not is_over(row)]


def tried_of(version: DriverVersion) -> Tried:
    """Sum up what was tried of a version."""
    rows = TryoutAct.objects.filter(tryout__version=version, answered_at__isnull=False)
    return tried(msgspec.convert(version.spec, DriverSpec), map(_act, rows.only(*_ACT)))


_ACT = ("sort", "name", "code", "has_faults", "data")


def _act(row: TryoutAct) -> AnsweredWish:
    is_ok = not row.code and not row.data.get("problems")
    return AnsweredWish(sort=row.sort, name=row.name, is_ok=is_ok, has_faults=row.has_faults)
