"""Preconditions for parts of a device to come, go and become otherwise."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from uuid import UUID

import msgspec

from labweb.domain.crutd.operations import Refit
from labweb.domain.crutd.snapshot import Facts, ResourceState, Snapshot
from labweb.domain.errors import Finding
from labweb.domain.graph.attachments import to_json
from labweb.domain.graph.lab_file.resource_config import check_config
from labweb.domain.resources.contents_by_lot import total_nl
from labweb.domain.resources.placement import PlacedThing, check_arriving
from labweb.domain.resources.resource_kinds import KINDS
from labweb.domain.units import render_mass, render_volume


def check_refit(operation: Refit, snapshot: Snapshot, facts: Facts | None) -> list[Finding]:
    """List all that speaks against it: matter, tubes, reservations, a place that is taken.

    Args:
        operation: What is to be.
        snapshot: The parts that are there.
        facts: What the server knows besides; an edge host refits nothing.
    """
    findings = list(_check_archive(operation, snapshot))
    for resource_id in operation.gone:
        findings += _check_going(snapshot[resource_id])
    for resource_id, config in operation.configs.items():
        state = snapshot[resource_id]
        findings += check_config(state.kind, config, state.name)
        findings += _check_room(state, config.get("capacity_ul"))
    for create in operation.added:
        findings += check_config(create.kind, create.config, create.key)
        if create.kind not in KINDS:
            findings.append(Finding("crutd.unknown_kind", f"no kind {create.kind!r}", create.key))
    findings += _check_once(operation)
    if facts is None:
        return findings
    return [*findings, *_check_places(operation, snapshot, facts), *_check_around(snapshot, facts)]


def _check_places(operation: Refit, snapshot: Snapshot, facts: Facts) -> list[Finding]:
    """Refuse parts that come where there is no room; those that go make room."""
    gone = set(operation.gone)
    places = [
        replace(place, there=tuple(one for one in place.there if one.id not in gone))
        for place in facts.places
    ]
    arriving = [
        (PlacedThing(one.resource_id, one.name, one.kind), one.parent_id) for one in operation.added
    ]
    for resource_id, parent_id in operation.back.items():
        state = snapshot[resource_id]
        arriving.append((PlacedThing(state.id, state.name, state.kind), parent_id))
    return check_arriving(arriving, places)


def _check_archive(operation: Refit, snapshot: Snapshot) -> Iterator[Finding]:
    if not operation.gone and not operation.back:
        return
    archive = operation.archive_id
    if isinstance(archive, msgspec.UnsetType) or snapshot[archive].kind != "archive":
        yield Finding("crutd.no_archive", "the lab has no Archive to keep the parts in", "archive")


def _check_once(operation: Refit) -> Iterator[Finding]:
    """Refuse two parts, or two tubes, of one key: a lab has each key once."""
    parts = Counter(create.key for create in operation.added)
    tubes = Counter(joint.key for joint in operation.joined)
    for what, keys in (("parts", parts), ("tubes", tubes)):
        for key in sorted(key for key, count in keys.items() if count > 1):
            text = f"{keys[key]} {what} that come have the key {key!r}: correct the version"
            yield Finding("crutd.taken", text, key)


def _check_going(state: ResourceState) -> Iterator[Finding]:
    """Refuse a part that holds something: it would go out of service with what is in it."""
    if not state.contents and not state.masses:
        return
    held = total_nl(state.contents)
    told = render_volume(held) if held else render_mass(total_nl(state.masses))
    yield Finding(
        "crutd.holds_matter",
        f"{state.name} is to go and holds {told}: empty it, or take stock of it",
        str(state.id),
        {"resource_id": str(state.id)},
    )


def _check_room(state: ResourceState, capacity_ul: float | None) -> Iterator[Finding]:
    held = total_nl(state.contents)
    if capacity_ul is not None and held > round(capacity_ul * 1000):
        yield Finding(
            "crutd.holds_matter",
            f"{state.name} holds {render_volume(held)}, more than the {capacity_ul:g} µL that it "
            "would hold with this version: empty it first",
            str(state.id),
            {"resource_id": str(state.id)},
        )


def _check_around(snapshot: Snapshot, facts: Facts) -> Iterator[Finding]:
    for one in facts.attachments:
        name = _name(one.own.resource_id, snapshot, facts)
        text = (
            f"{name} goes, or loses its port {one.own.port or 'there'}, and {one.key} "
            f"({one.medium.value}) leads to it: take it off first"
        )
        yield Finding("crutd.connected", text, one.key, {"connections": [to_json(one)]})
    for state in facts.inside.values():
        yield from _check_going(state)
        text = f"{state.name} stands in a part that goes: carry it away first"
        yield Finding("crutd.occupied", text, str(state.id), {"resource_id": str(state.id)})
    for resource_id, told in facts.reserved.items():
        name = _name(resource_id, snapshot, facts)
        yield Finding("crutd.reserved", f"{name} goes, and is reserved {told}", str(resource_id))
    if facts.is_taken:
        yield Finding("crutd.taken", "a part that comes has a key or an id that is taken", "")
    for key in facts.taken_tubes:
        text = f"a tube that comes has the key {key!r}, and a connection of this key is there"
        yield Finding("crutd.taken", f"{text} already: take it off, or join it otherwise", key)


def _name(resource_id: UUID, snapshot: Snapshot, facts: Facts) -> str:
    state = snapshot.get(resource_id) or facts.inside.get(resource_id)
    return str(resource_id) if state is None else state.name
