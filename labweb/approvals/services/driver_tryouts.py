"""Writes of drivers that are tried on simulated instruments: begun, asked, told, ended.

A tryout is no device. It has no resource, no job and no transaction, and no amount of matter
hangs on it; see docs/decisions/0011-a-tryout-is-no-device.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any, cast
from uuid import UUID

import jsonschema
import msgspec
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.approvals import selectors
from labweb.approvals.models import SimulatorOffer, Tryout, TryoutAct
from labweb.common import feed
from labweb.common.clock import now
from labweb.common.signatures import signing
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.enrollment.driver_bundle import PART_BYTES, digest_of, encode_bundle
from labweb.domain.enrollment.driver_spec import DriverSpec, check_arguments, check_config
from labweb.domain.enrollment.driver_tryout import (
    FASTEST,
    GRACE_S,
    MOST_ACTS,
    MOST_AT_ONCE,
    READ_WITHIN_S,
)
from labweb.domain.errors import (
    DefinitionError,
    Finding,
    LockedError,
    NotFoundError,
    PreconditionError,
    StateError,
)
from labweb.domain.messages.driver_tryouts import (
    MOST_WIRE_RECORDS,
    AskSort,
    SimulatedModel,
    TryoutAsk,
    TryoutOffer,
    TryoutOrder,
    TryoutPart,
    TryoutTold,
)
from labweb.enrollment.selectors import (
    DriverVersion,
    EdgeHost,
    driver_for_update,
    host_for_update,
)
from labweb.enrollment.services import tell_host
from labweb.resources import selectors as resource_selectors

_TRIABLE = {DriverVersion.State.PROPOSED, DriverVersion.State.APPROVED}
MOST_DATA_BYTES = 32 * 1024
"""Longest answer of a driver that is kept; of a longer one only how long it was."""

_STATES = {"running": Tryout.State.RUNNING, "ended": Tryout.State.ENDED}


class TryoutWanted(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """On what a version is to be tried."""

    host_id: UUID
    model: str
    settings: dict[str, Any] = msgspec.field(default_factory=dict)
    """Of the simulated instrument."""

    config: dict[str, Any] = msgspec.field(default_factory=dict)
    """Of the driver."""

    speed: float = 1.0


class TryoutWish(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What an author wants of a tryout that runs."""

    sort: AskSort
    name: str = ""
    args: dict[str, Any] = msgspec.field(default_factory=dict)


@atomic
def begin_tryout(version_id: UUID, wanted: TryoutWanted, *, actor: User) -> Tryout:
    """Order a host to try a version on a simulated instrument; nobody need have approved it.

    Raises:
        NotFoundError: There is no such version or host.
        ForbiddenError: The actor may not bring drivers.
        StateError: The version was rejected or withdrawn, or the host offers no such model now.
        LockedError: The host tries as many drivers as it may.
        DefinitionError: Settings do not fit; `findings` list each.

    Effect:
        None. What moves is simulated, and stands in no tree and no ledger.
    """
    _require(actor)
    host = host_for_update(wanted.host_id)  # first, as where a device is given a version
    version = driver_for_update(version_id)
    if version.state not in _TRIABLE or digest_of(version.sources) != version.digest:
        raise StateError(f"{version} is {version.state}: nothing to try", code="tryout.version")
    model = _model(host, version, wanted.model)
    _check(version, model, wanted)
    if len(selectors.going_on(host)) >= MOST_AT_ONCE:
        text = f"{host.name} tries {MOST_AT_ONCE} drivers already: end one, or wait"
        raise LockedError(text, code="tryout.busy")
    row = Tryout.objects.create(
        version=version,
        host=host,
        epoch=host.epoch,
        model=model.model,
        title=model.title,
        faults_offered=model.faults,
        settings=wanted.settings,
        config=wanted.config,
        speed=wanted.speed,
        begun_by=actor,
        begun_at=now(),
        heard_at=now(),
    )
    detail = {"digest": version.digest, "model": model.model, "host_id": str(host.id)}
    account_services.write_audit("driver.tryout", str(row.id), actor=actor, detail=detail)
    _send(row, 0)
    return row


@atomic
def ask_tryout(tryout_id: UUID, wish: TryoutWish, *, actor: User) -> TryoutAct:
    """Have a tryout act, read, stop, take a fault or lose all of them, or end.

    Raises:
        NotFoundError: There is no such tryout, action or fault.
        ForbiddenError: The actor may not bring drivers.
        StateError: It does not run, or has taken as many wishes as it may.
        PreconditionError: The arguments do not fit the action; `findings` list each.
        DefinitionError: The options do not fit the fault.

    Effect:
        None: what moves is simulated.
    """
    _require(actor)
    row = selectors.tryout_for_update(tryout_id)
    if row.state != Tryout.State.RUNNING or selectors.is_over(row):
        text = f"it does not run: {row.message or row.state}"
        raise StateError(text, code="tryout.not_running")
    number = row.acts.count() + 1
    if number > MOST_ACTS and wish.sort != "end":
        text = f"it has taken {MOST_ACTS} wishes: end it, and begin another"
        raise StateError(text, code="tryout.too_many")
    _check_wish(row, wish)
    act = TryoutAct.objects.create(
        tryout=row,
        number=number,
        sort=wish.sort,
        name=wish.name,
        args=wish.args,
        asked_at=now(),
        has_faults=bool(row.faults),
    )
    _send(row, number)
    return act


def frames_of(
    host_id: UUID, epoch: int, tryout_id: UUID, number: int
) -> list[TryoutPart | TryoutAsk]:
    """Return what a host is to be sent: number 0, the source with its order; else that wish."""
    row = Tryout.objects.filter(pk=tryout_id, host_id=host_id, epoch=epoch).first()
    if row is None or row.state == Tryout.State.ENDED:
        return []
    if number:
        act = row.acts.get(number=number)
        return [_ask(row, act)]
    data = encode_bundle(row.version.sources)
    pieces = [data[at : at + PART_BYTES] for at in range(0, len(data), PART_BYTES)]
    order = signing.sign(_order(row))
    return [
        TryoutPart(
            tryout_id=row.id,
            index=index,
            count=len(pieces),
            data=piece,
            order=order if index == 0 else None,
        )
        for index, piece in enumerate(pieces)
    ]


@atomic
def take_offer(host_id: UUID, epoch: int, frame: TryoutOffer) -> None:
    """Keep what a host can simulate in this session."""
    if not EdgeHost.objects.filter(pk=host_id, epoch=epoch).exists():
        return
    SimulatorOffer.objects.update_or_create(
        host_id=host_id,
        defaults={
            "epoch": epoch,
            "models_offered": msgspec.to_builtins(frame.models),
            "problem": frame.problem[:500],
            "told_at": now(),
        },
    )
    on_commit(partial(feed.publish, "tryouts", {"host_id": str(host_id)}))


@atomic
def take_told(host_id: UUID, epoch: int, told: TryoutTold) -> None:
    """Write down what became of a tryout and of a wish; of another session's nothing counts."""
    rows = Tryout.objects.filter(pk=told.tryout_id, host_id=host_id, epoch=epoch)
    row = (
        rows.exclude(state=Tryout.State.ENDED).select_for_update(of=("self",), no_key=True).first()
    )
    if row is None:
        return
    had_faults = bool(row.faults)
    row.state, row.heard_at, row.faults = _STATES[told.state], now(), told.faults[:40]
    records = [list(msgspec.structs.astuple(one)) for one in told.wire]
    dropped = max(0, len(row.wire) + len(records) - MOST_WIRE_RECORDS)
    row.wire = [*row.wire, *records][-MOST_WIRE_RECORDS:]
    row.wire_left_out_count += told.wire_left_out_count + dropped
    if told.number:
        _take_answer(row, told, has_faults=had_faults or bool(told.faults))
    if row.state == Tryout.State.ENDED:
        row.ended_at, row.code, row.message = now(), told.code[:100], told.message[:2000]
        row.faults = []
        on_commit(partial(feed.publish, "drivers", {"tryout_id": str(row.id)}))
    row.save()
    on_commit(partial(feed.publish, "tryouts", {"tryout_id": str(row.id)}))


def _take_answer(row: Tryout, told: TryoutTold, *, has_faults: bool) -> None:
    act = row.acts.filter(number=told.number, answered_at__isnull=True).first()
    if act is None:
        return
    act.answered_at, act.code, act.message = now(), told.code[:100], told.message[:2000]
    act.effect, act.data = told.effect[:10], told.data
    size_bytes = len(msgspec.json.encode(told.data))
    if size_bytes > MOST_DATA_BYTES:
        act.data = {"left_out_bytes": size_bytes}
    act.has_faults = act.has_faults or has_faults
    act.save()
    if act.sort == "read" and not act.code:
        row.statuses = act.data


def _require(actor: User) -> None:
    root = resource_selectors.root_of(resource_selectors.the_lab())
    resource_selectors.require(actor, Permission.SUBMIT, [root.id])


def _model(host: EdgeHost, version: DriverVersion, name: str) -> SimulatedModel:
    offer = selectors.offer_of(host)
    if offer is None or host.suspended_at is not None:
        text = f"{host.name} tries no drivers now: it is away, or does not offer it"
        raise StateError(text, code="tryout.no_host")
    for one in selectors.models_for(offer, version):
        if one.model == name:
            return one
    text = f"{host.name} has no simulated instrument {name!r:.60} that fits {version.class_name}"
    raise NotFoundError(text, code="tryout.no_model")


def _check(version: DriverVersion, model: SimulatedModel, wanted: TryoutWanted) -> None:
    findings = check_config(msgspec.convert(version.spec, DriverSpec), wanted.config)
    findings += _misfits(model.settings, wanted.settings, model.model)
    if not (math.isfinite(wanted.speed) and 1 <= wanted.speed <= FASTEST):
        text = f"simulated time runs 1 to {FASTEST:g} times as fast; got {wanted.speed:g}"
        findings.append(Finding("tryout.speed", text, subject="speed"))
    if findings:
        text = "; ".join(one.message for one in findings)
        raise DefinitionError(text, code="tryout.settings", findings=findings)


def _check_wish(row: Tryout, wish: TryoutWish) -> None:
    if wish.sort == "act":
        action = msgspec.convert(row.version.spec, DriverSpec).action(wish.name)
        if findings := check_arguments(action, wish.args):
            text = "; ".join(one.message for one in findings)
            raise PreconditionError(text, code="driver.arguments", findings=findings)
    elif wish.sort == "fault":
        schema = row.faults_offered.get(wish.name)
        if schema is None:
            raise NotFoundError(f"{row.title} has no fault {wish.name!r:.60}", code="tryout.fault")
        if findings := _misfits(schema, wish.args, wish.name):
            text = "; ".join(one.message for one in findings)
            raise DefinitionError(text, code="tryout.fault", findings=findings)
    elif wish.name or wish.args:
        raise DefinitionError(f"{wish.sort} takes neither name nor arguments", code="tryout.wish")


def _misfits(schema: Mapping[str, Any], values: object, subject: str) -> list[Finding]:
    found = jsonschema.Draft202012Validator(schema).iter_errors(values)
    return [
        Finding(
            "tryout.setting",
            f"{'.'.join(map(str, one.path)) or subject}: {one.message[:200]}",
            subject=f"{subject}.{'.'.join(map(str, one.path))}".rstrip("."),
        )
        for one in found
    ]


def _within_s(row: Tryout, act: TryoutAct) -> float:
    if act.sort != "act":
        return READ_WITHIN_S
    action = msgspec.convert(row.version.spec, DriverSpec).action(act.name)
    return (action.timeout_s or READ_WITHIN_S) + GRACE_S


def _ask(row: Tryout, act: TryoutAct) -> TryoutAsk:
    return TryoutAsk(
        tryout_id=row.id,
        number=act.number,
        sort=cast("AskSort", act.sort),
        name=act.name,
        args=act.args,
        within_s=_within_s(row, act),
    )


def _order(row: Tryout) -> TryoutOrder:
    return TryoutOrder(
        tryout_id=row.id,
        host_id=row.host_id,
        epoch=row.epoch,
        digest=row.version.digest,
        class_name=row.version.class_name,
        config=row.config,
        model=row.model,
        settings=row.settings,
        speed=row.speed,
        asked_by=str(row.begun_by_id),
    )


def _send(row: Tryout, number: int) -> None:
    message = {"type": "edge.tryout", "tryout_id": str(row.id), "number": number}
    on_commit(partial(tell_host, row.host_id, message))
    on_commit(partial(feed.publish, "tryouts", {"tryout_id": str(row.id)}))
