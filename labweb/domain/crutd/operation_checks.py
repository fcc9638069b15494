"""Preconditions of the operations: what may not be done, and why.

The server asks under its locks with all `Facts`; an edge host knows its resources only, and
relies on the server for what concerns lots.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from uuid import UUID

from labweb.domain.crutd.archiving import check_archiving
from labweb.domain.crutd.device_parts_refit import check_refit
from labweb.domain.crutd.disconnect import check_disconnect
from labweb.domain.crutd.operations import (
    Correct,
    Create,
    Delete,
    Disconnect,
    Dispose,
    Operation,
    React,
    Read,
    Receive,
    Refit,
    Restore,
    TransferLiquid,
    TransferMass,
    TransferResource,
    Update,
    touched_ids,
)
from labweb.domain.crutd.reaction import check_react
from labweb.domain.crutd.receive_correct_dispose import (
    check_correct,
    check_dispose,
    check_expiry,
    check_meeting,
    check_receive,
    check_room,
    known_lots,
)
from labweb.domain.crutd.snapshot import Facts, ResourceState, Snapshot
from labweb.domain.errors import Finding
from labweb.domain.graph.attachments import check_loose
from labweb.domain.graph.lab_file.resource_config import check_config
from labweb.domain.resources.contents_by_lot import LotId, Phase, total_nl
from labweb.domain.resources.placement import PlacedThing, check_standing
from labweb.domain.resources.resource_kinds import KINDS
from labweb.domain.units import render_mass, render_volume

_NONE: frozenset[LotId] = frozenset()


def check(operation: Operation, snapshot: Snapshot, facts: Facts | None = None) -> list[Finding]:
    """List every precondition the operation breaks; an empty list means go."""
    if isinstance(operation, Read):
        return []
    missing = [i for i in touched_ids(operation) if i not in snapshot]
    if missing:
        return [Finding("crutd.not_found", f"no resource {i}", str(i)) for i in missing]
    return [*_check_usable(operation, snapshot, facts), *_check_own(operation, snapshot, facts)]


def _check_own(operation: Operation, snapshot: Snapshot, facts: Facts | None) -> Sequence[Finding]:
    match operation:
        case TransferLiquid():
            return _check_liquid(operation, snapshot, facts)
        case TransferMass():
            return _check_mass(operation, snapshot, facts)
        case TransferResource() | Restore():
            return _check_carry(operation, snapshot, facts)
        case Delete():
            return check_archiving(operation, snapshot, facts)
        case Create():
            return _check_create(operation, snapshot, facts)
        case Update():
            return _check_update(operation, snapshot)
        case Refit():
            return check_refit(operation, snapshot, facts)
        case Disconnect():
            return check_disconnect(operation, snapshot, facts)
        case Read():
            return []
        case _:
            return _check_booked(operation, snapshot, facts)


def _check_booked(
    operation: Receive | Correct | Dispose | React, snapshot: Snapshot, facts: Facts | None
) -> list[Finding]:
    match operation:
        case Receive():
            return check_receive(operation, snapshot, facts)
        case Correct():
            return check_correct(operation, snapshot, facts)
        case Dispose():
            return check_dispose(operation, snapshot)
        case React():
            return check_react(operation, snapshot, facts)


def _check_update(operation: Update, snapshot: Snapshot) -> list[Finding]:
    state = snapshot[operation.resource_id]
    held_nl = total_nl(state.contents)
    if not operation.needs_empty or held_nl == 0:
        return []
    return [
        Finding(
            "crutd.not_empty",
            f"{state.name} holds {render_volume(held_nl)} by the record, and this act would push "
            "it out unrecorded: empty it, or take stock of what it really holds",
            state.name,
            {"resource_id": str(state.id), "held_nl": held_nl},
        )
    ]


def _check_usable(
    operation: Operation, snapshot: Snapshot, facts: Facts | None
) -> Iterator[Finding]:
    back = set(operation.back) if isinstance(operation, Refit) else set()
    back |= {operation.resource_id} if isinstance(operation, Restore) else set()
    for resource_id in touched_ids(operation):
        state = snapshot[resource_id]
        if state.quarantined_by is not None and not isinstance(operation, Correct):
            yield Finding(
                "crutd.quarantined",
                f"{state.name} is quarantined: a person has to say what happened first",
                str(resource_id),
                {"transaction_id": state.quarantined_by},
            )
        if state.is_archived and resource_id not in back:
            yield Finding("crutd.archived", f"{state.name} is in the Archive", str(resource_id))
        if resource_id in back and not state.is_archived:
            yield Finding("crutd.not_archived", f"{state.name} is in service", str(resource_id))
        if facts is not None and resource_id in facts.held:
            yield Finding(
                "crutd.held_elsewhere",
                f"{state.name} is in use by another operation",
                str(resource_id),
                {"transaction_id": facts.held[resource_id]},
            )


def _check_liquid(
    operation: TransferLiquid, snapshot: Snapshot, facts: Facts | None
) -> list[Finding]:
    source, target = snapshot[operation.source_id], snapshot[operation.target_id]
    if operation.source_id == operation.target_id:
        return [Finding("crutd.same_vessel", "source and target are the same vessel", source.name)]
    findings = []
    if operation.amount_nl <= 0:
        findings.append(
            Finding("crutd.not_positive", f"{operation.amount_nl} nL is no amount", source.name)
        )
    usable = total_nl(source.contents) - source.dead_volume_nl
    if operation.amount_nl > usable:
        findings.append(
            Finding(
                "crutd.insufficient_volume",
                f"{source.name} can give {render_volume(max(usable, 0))}, "
                f"asked for {render_volume(operation.amount_nl)}",
                source.name,
                {"resource_id": str(source.id), "usable_nl": usable},
            )
        )
    findings += _check_parts(operation, source, facts)
    findings += check_room(target, operation.amount_nl, Phase.LIQUID)
    findings += _check_carried(operation, source, target, facts)
    keeps = frozenset(LotId(str(lot)) for lot in operation.keeps)
    stated = keeps | {LotId(lot) for lot in operation.carries_ug}
    findings += _check_phases(source, Phase.LIQUID, facts, stated)
    return [*findings, *_check_lots(source, target, facts, keeps)]


def _check_carried(
    operation: TransferLiquid, source: ResourceState, target: ResourceState, facts: Facts | None
) -> Iterator[Finding]:
    """Refuse more of a solid to go along than there is, and a lot of which two things are said.

    It needs no room of its own, but where somebody stated how much of solids a vessel holds.
    """
    for lot in sorted(operation.carries_ug.keys() & {str(lot) for lot in operation.keeps}):
        text = f"of {_name(LotId(lot), facts)} it is said that it goes along, and that it stays"
        yield Finding("crutd.parts_disagree", text, source.name, {"lot_id": lot})
    if not operation.carries_ug or not source.knows_masses:
        return
    for lot, part in sorted(operation.carries_ug.items()):
        there = source.masses.get(LotId(lot), 0)
        if part > there:
            yield Finding(
                "crutd.insufficient_mass",
                f"{source.name} holds {render_mass(there)} of {_name(LotId(lot), facts)}, "
                f"asked for {render_mass(part)}",
                source.name,
                {"resource_id": str(source.id), "usable_ug": there, "lot_id": lot},
            )
    carried_ug = sum(operation.carries_ug.values())
    if carried_ug and target.capacity_ug is not None:
        yield from check_room(target, carried_ug, Phase.SOLID)


def _check_parts(
    operation: TransferLiquid, source: ResourceState, facts: Facts | None
) -> Iterator[Finding]:
    """Refuse parts of a layer that are not there, or that are not what is drawn in all."""
    parts = {LotId(lot): part for lot, part in operation.parts_nl.items()}
    if parts and total_nl(parts) != operation.amount_nl:
        text = (
            f"the lots of the layer come to {render_volume(total_nl(parts))}, "
            f"asked for {render_volume(operation.amount_nl)}"
        )
        yield Finding("crutd.parts_disagree", text, source.name)
    for lot, part in sorted(parts.items()):
        there = source.contents.get(lot, 0)
        if part > there:
            yield Finding(
                "crutd.insufficient_volume",
                f"{source.name} holds {render_volume(there)} of {_name(lot, facts)}, "
                f"asked for {render_volume(part)}",
                source.name,
                {"resource_id": str(source.id), "usable_nl": there, "lot_id": lot},
            )


def _check_mass(operation: TransferMass, snapshot: Snapshot, facts: Facts | None) -> list[Finding]:
    source, target = snapshot[operation.source_id], snapshot[operation.target_id]
    if operation.source_id == operation.target_id:
        return [Finding("crutd.same_vessel", "source and target are the same vessel", source.name)]
    findings = []
    if operation.amount_ug <= 0:
        findings.append(Finding("crutd.not_positive", "0 µg is no amount", source.name))
    if operation.phase is Phase.LIQUID:
        text = "a liquid is moved by its volume: give nanolitres"
        findings.append(Finding("crutd.unit_mismatch", text, source.name))
    if not source.knows_masses:
        return findings
    there = total_nl(source.masses)
    parts = operation.parts_ug.items()
    is_short = any(part > source.masses.get(LotId(lot), 0) for lot, part in parts)
    if operation.amount_ug > there or is_short:
        findings.append(
            Finding(
                "crutd.insufficient_mass",
                f"{source.name} holds {there / 1000:g} mg, "
                f"asked for {render_mass(operation.amount_ug)}",
                source.name,
                {"resource_id": str(source.id), "usable_ug": there},
            )
        )
    elif parts and sum(operation.parts_ug.values()) != operation.amount_ug:
        text = f"the lots of the mass do not come to {render_mass(operation.amount_ug)}"
        findings.append(Finding("crutd.parts_disagree", text, source.name))
    findings += check_room(target, operation.amount_ug, Phase.SOLID)
    findings += _check_phases(source, operation.phase, facts)
    return [*findings, *_check_lots(source, target, facts)]


def _check_phases(
    source: ResourceState, phase: Phase, facts: Facts | None, keeps: frozenset[LotId] = _NONE
) -> Iterator[Finding]:
    """Refuse to draw one phase from a vessel in which another may come along.

    A solid in a liquid may be dissolved, suspended or lie at the bottom: where nobody has said
    that it stays, nobody knows what a draw of the liquid carries. A gas stays above what is
    poured.
    """
    others = set(source.contents if phase is not Phase.LIQUID else ())
    for lot in source.masses.keys() - keeps:
        known = None if facts is None else facts.lots.get(lot)
        other = Phase.SOLID if known is None else known.phase
        if other is not phase and not (phase is Phase.LIQUID and other is Phase.GAS):
            others.add(lot)
    for lot in sorted(others):
        name = _name(lot, facts)
        yield Finding(
            "crutd.wrong_phase",
            f"{source.name} also holds {name}, which is no {phase.value}: take stock of what "
            "became of it first",
            source.name,
            {"resource_id": str(source.id), "lot_id": lot},
        )


def _name(lot: LotId, facts: Facts | None) -> str:
    known = None if facts is None else facts.lots.get(lot)
    return f"lot {lot}" if known is None else known.name


def _check_lots(
    source: ResourceState,
    target: ResourceState,
    facts: Facts | None,
    keeps: frozenset[LotId] = _NONE,
) -> list[Finding]:
    """Look at the lots that would be drawn, and at those they would meet."""
    if facts is None:
        return []
    drawn = [lot for lot in known_lots(source, facts) if lot.id not in keeps]
    findings = list(check_meeting(drawn, known_lots(target, facts), target))
    kind = KINDS.get(source.kind)
    is_on_its_way = kind is not None and kind.nature is not KINDS["bottle"].nature
    if not is_on_its_way and target.kind != "waste":
        findings += check_expiry(drawn, facts, source)
    return findings


def _check_carry(
    operation: TransferResource | Restore, snapshot: Snapshot, facts: Facts | None
) -> list[Finding]:
    moved = snapshot[operation.resource_id]
    if not isinstance(operation.to_id, UUID):
        return [_no_former_place(moved)]
    to = snapshot[operation.to_id]
    attachments = () if facts is None else facts.attachments
    findings = check_loose(moved.name, str(moved.id), attachments)
    if moved.parent_id != operation.from_id:
        findings.append(
            Finding("crutd.not_there", f"{moved.name} does not stand there", moved.name)
        )
    is_in_place = isinstance(operation, TransferResource) and operation.from_id == operation.to_id
    if not is_in_place:
        findings += _check_place(PlacedThing(moved.id, moved.name, moved.kind), to)
    if operation.resource_id == operation.to_id or operation.resource_id in to.ancestor_ids:
        findings.append(
            Finding("crutd.into_itself", f"{moved.name} cannot stand in itself", moved.name)
        )
    return findings


def _no_former_place(thing: ResourceState) -> Finding:
    text = (
        f"nobody wrote down where {thing.name} stood before it was archived: say where it is to "
        "go (to_id)"
    )
    return Finding("crutd.no_former_place", text, str(thing.id), {"field": "to_id"})


def _check_place(thing: PlacedThing, place: ResourceState) -> list[Finding]:
    """Refuse the Archive, where things are out of service, and what the place has no room for."""
    if place.kind == "archive":
        text = f"what goes to {place.name} goes out of service: take it there by deleting it"
        return [Finding("crutd.into_archive", text, place.name)]
    there = [one for one in place.there if one.id != thing.id]
    return check_standing(thing, place, there, place.sites_count)


def _check_create(operation: Create, snapshot: Snapshot, facts: Facts | None) -> list[Finding]:
    findings = []
    if operation.kind not in KINDS:
        findings.append(Finding("crutd.unknown_kind", f"no kind {operation.kind!r}", operation.key))
    else:
        findings += check_config(operation.kind, operation.config, operation.key)
        thing = PlacedThing(operation.resource_id, operation.name, operation.kind)
        findings += _check_place(thing, snapshot[operation.parent_id])
    if facts is not None and facts.is_taken:
        text = f"a resource with the id or the key {operation.key!r} is there already"
        findings.append(Finding("crutd.taken", text, operation.key))
    return findings
