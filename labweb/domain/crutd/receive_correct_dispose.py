"""Preconditions of what comes into the lab, is taken stock of, and leaves it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from labweb.domain.crutd.ledger import CORRECTION_ACCOUNTS
from labweb.domain.crutd.operations import Correct, Dispose, Receive
from labweb.domain.crutd.snapshot import Facts, LotState, ResourceState, Snapshot
from labweb.domain.errors import Finding
from labweb.domain.resources.contents_by_lot import LotId, Phase, total_nl
from labweb.domain.resources.resource_kinds import is_vessel
from labweb.domain.units import render_mass, render_volume


def check_room(target: ResourceState, amount: int, phase: Phase) -> list[Finding]:
    """List why an amount does not fit into a vessel: no room, or nobody stated how much."""
    if phase is Phase.LIQUID:
        capacity, held, name = target.capacity_nl, total_nl(target.contents), "capacity_ul"
    else:
        capacity, held, name = target.capacity_ug, total_nl(target.masses), "capacity_mg"
    if capacity is None:
        text = f"nobody stated how much {target.name} holds: set {name} in its config"
        context = {"resource_id": str(target.id)}
        return [Finding("crutd.unknown_capacity", text, target.name, context)]
    if amount <= capacity - held:
        return []
    free, unit = capacity - held, phase.unit
    text = f"{target.name} has room for {phase.render(free)}, asked for {phase.render(amount)}"
    facts = {"resource_id": str(target.id), f"free_{unit}": free}
    return [Finding("crutd.capacity_exceeded", text, target.name, facts)]


def known_lots(state: ResourceState, facts: Facts) -> list[LotState]:
    """Return what is known of the lots in a vessel."""
    return [facts.lots[lot] for lot in (*state.contents, *state.masses) if lot in facts.lots]


def check_expiry(lots: Iterable[LotState], facts: Facts, where: ResourceState) -> Iterator[Finding]:
    """Refuse to use a lot after its last day."""
    for lot in lots:
        if lot.expires_on is not None and lot.expires_on < facts.on:
            yield Finding(
                "crutd.expired_lot",
                f"{lot.name} in {where.name} expired on {lot.expires_on.isoformat()}",
                where.name,
                {"lot_id": lot.id, "expires_on": lot.expires_on.isoformat()},
            )


def check_meeting(
    coming: Iterable[LotState], there: Sequence[LotState], where: ResourceState
) -> Iterator[Finding]:
    """Refuse to bring materials together of which one lists the other."""
    for lot in coming:
        for other in there:
            if lot.material.is_incompatible_with(other.material):
                yield Finding(
                    "crutd.incompatible",
                    f"{lot.material.name} must not meet {other.material.name}, "
                    f"which is in {where.name}",
                    where.name,
                    {"lot_id": lot.id, "other_lot_id": other.id},
                )


def check_receive(operation: Receive, snapshot: Snapshot, facts: Facts | None) -> list[Finding]:
    """List why a delivery cannot be taken in."""
    findings = [*_check_delivery(operation, facts)]
    vessels = [portion.resource_id for portion in operation.portions]
    if len(set(vessels)) != len(vessels):
        findings.append(Finding("crutd.same_vessel", "a vessel is named twice", operation.key))
    for portion in operation.portions:
        state = snapshot[portion.resource_id]
        amounts = {"nl": portion.amount_nl, "ug": portion.amount_ug}
        amount = amounts.pop(operation.phase.unit)
        if any(amounts.values()):
            text = f"a {operation.phase.value} is counted in {operation.phase.unit}"
            findings.append(Finding("crutd.unit_mismatch", text, state.name))
        elif amount <= 0:
            findings.append(Finding("crutd.not_positive", "0 is no amount", state.name))
        if not is_vessel(state.kind):
            findings.append(Finding("crutd.no_vessel", f"{state.name} holds nothing", state.name))
            continue
        findings += check_room(state, amount, operation.phase)
        if facts is not None and facts.material is not None:
            there = known_lots(state, facts)
            findings += check_meeting([_lot_of(operation, facts)], there, state)
    return findings


def _lot_of(operation: Receive, facts: Facts) -> LotState:
    if facts.material is None:
        raise ValueError("a delivery of no known material")
    return LotState(
        id=LotId(str(operation.lot_id)),
        name=operation.number or operation.key,
        phase=operation.phase,
        material=facts.material,
        expires_on=operation.expires_on,
    )


def _check_delivery(operation: Receive, facts: Facts | None) -> Iterator[Finding]:
    if facts is None:
        return
    subject = operation.number or operation.key
    if facts.material is None:
        text = f"no material {operation.material_id}"
        yield Finding("crutd.no_material", text, str(operation.material_id))
    if facts.is_known_delivery:
        text = f"{subject} was received already: a lot comes once, in all its vessels together"
        yield Finding("crutd.lot_received_twice", text, subject)
    if operation.expires_on is not None and operation.expires_on < facts.on:
        text = f"{subject} expired on {operation.expires_on.isoformat()}"
        yield Finding("crutd.expired_lot", text, subject)


def check_correct(operation: Correct, snapshot: Snapshot, facts: Facts | None) -> list[Finding]:
    """List why a measurement cannot be what a vessel holds."""
    state = snapshot[operation.resource_id]
    findings = []
    if operation.account not in CORRECTION_ACCOUNTS:
        wanted = ", ".join(sorted(CORRECTION_ACCOUNTS))
        text = f"a difference goes to one of {wanted}"
        findings.append(Finding("crutd.bad_account", text, operation.account.value))
    if not operation.reason.strip():
        text = "a correction needs a reason: what was measured, and how"
        findings.append(Finding("crutd.reason_missing", text, state.name))
    is_measured = bool(operation.measured_nl or operation.measured_ug)
    # A person may also have looked at a quarantined thing that holds nothing, such as a heater.
    if not is_vessel(state.kind) and (is_measured or state.quarantined_by is None):
        findings.append(Finding("crutd.no_vessel", f"{state.name} holds nothing", state.name))
    findings += _check_units(operation.measured_nl, "nl", facts, state)
    findings += _check_units(operation.measured_ug, "ug", facts, state)
    measured = (
        (operation.measured_nl, state.capacity_nl, "capacity_ul"),
        (operation.measured_ug, state.capacity_ug, "capacity_mg"),
    )
    for amounts, capacity, name in measured:
        if capacity is not None and sum(amounts.values()) > capacity:
            text = f"{state.name} cannot hold that much: see its {name}"
            findings.append(Finding("crutd.capacity_exceeded", text, state.name))
    return findings


def _check_units(
    measured: Mapping[str, int], unit: str, facts: Facts | None, state: ResourceState
) -> Iterator[Finding]:
    for lot in sorted(measured):
        known = None if facts is None else facts.lots.get(LotId(lot))
        if known is None:
            if facts is not None:
                yield Finding("crutd.no_lot", f"no lot {lot}", state.name, {"lot_id": lot})
        elif known.phase.unit != unit:
            text = f"{known.name} is a {known.phase.value}, counted in {known.phase.unit}"
            yield Finding("crutd.unit_mismatch", text, state.name, {"lot_id": lot})


def check_dispose(operation: Dispose, snapshot: Snapshot) -> list[Finding]:
    """List why that cannot be poured away."""
    state = snapshot[operation.resource_id]
    liquid, solid = operation.amount_nl or 0, operation.amount_ug or 0
    is_all = operation.amount_nl is None and operation.amount_ug is None
    findings = []
    if is_all and not state.contents and not state.masses:
        findings.append(Finding("crutd.empty", f"{state.name} is empty", state.name))
    if not is_all and not liquid and not solid:
        findings.append(Finding("crutd.not_positive", "0 is no amount", state.name))
    if not is_all and state.contents and state.masses:
        text = f"{state.name} holds a liquid and a solid: a part of it cannot be told"
        findings.append(Finding("crutd.wrong_phase", text, state.name))
    if liquid > total_nl(state.contents):
        there = render_volume(total_nl(state.contents))
        text = f"{state.name} holds {there}"
        findings.append(Finding("crutd.insufficient_volume", text, state.name))
    if solid > total_nl(state.masses):
        text = f"{state.name} holds {render_mass(total_nl(state.masses))}"
        findings.append(Finding("crutd.insufficient_mass", text, state.name))
    return findings
