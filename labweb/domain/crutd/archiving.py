"""What keeps a resource, and all that stands in it, from going to the Archive."""

from __future__ import annotations

from collections.abc import Iterator
from uuid import UUID

from labweb.domain.crutd.operations import Delete
from labweb.domain.crutd.snapshot import Facts, ResourceState, Snapshot
from labweb.domain.errors import Finding
from labweb.domain.graph.attachments import to_json
from labweb.domain.resources.contents_by_lot import total_nl
from labweb.domain.units import render_mass, render_volume


def check_archiving(operation: Delete, snapshot: Snapshot, facts: Facts | None) -> list[Finding]:
    """List all that speaks against it: matter, connections, doubts, and where it stands.

    Args:
        operation: What is to go.
        snapshot: The resource and the Archive.
        facts: What stands in it and what is connected to that; None asks of it alone.
    """
    state, archive = snapshot[operation.resource_id], snapshot[operation.archive_id]
    if state.parent_id is None:
        return [Finding("crutd.root", f"{state.name} is the root of the lab", state.name)]
    if archive.kind != "archive":
        return [Finding("crutd.no_archive", "the target is no Archive", state.name)]
    if state.id == archive.id or state.id in archive.ancestor_ids:
        return [Finding("crutd.into_itself", f"{state.name} cannot stand in itself", state.name)]
    if isinstance(operation.from_id, UUID) and operation.from_id != state.parent_id:
        text = f"{state.name} was carried elsewhere just now: look again"
        return [Finding("crutd.not_there", text, state.name)]
    findings = list(_check_empty(state, state))
    if facts is None:
        return findings
    for one in facts.inside.values():
        findings += _check_empty(one, state)
        if one.quarantined_by is not None:
            text = f"{one.name} is quarantined: a person has to say what happened first"
            context = {"transaction_id": one.quarantined_by}
            findings.append(Finding("crutd.quarantined", text, str(one.id), context))
    return [*findings, *_check_loose(state, facts)]


def _check_empty(state: ResourceState, leaving: ResourceState) -> Iterator[Finding]:
    if not state.contents and not state.masses:
        return
    held = total_nl(state.contents)
    told = render_volume(held) if held else render_mass(total_nl(state.masses))
    where = "" if state.id == leaving.id else f", which stands in {leaving.name},"
    text = (
        f"{state.name}{where} holds {told} and cannot go to the Archive: move that elsewhere, or "
        "dispose of it, first"
    )
    yield Finding(
        "crutd.holds_matter",
        text,
        str(state.id),
        {"resource_id": str(state.id), "held_nl": held, "held_ug": total_nl(state.masses)},
    )


def _check_loose(leaving: ResourceState, facts: Facts) -> Iterator[Finding]:
    names = {one.id: one.name for one in facts.inside.values()} | {leaving.id: leaving.name}
    for one in facts.attachments:
        name = names.get(one.own.resource_id, leaving.name)
        text = (
            f"{name} is connected by {one.key} ({one.medium.value}) and cannot go to the Archive: "
            "take this connection off first (Take off… at Lab, or the operation disconnect)"
        )
        context = {"resource_id": str(one.own.resource_id), "connections": [to_json(one)]}
        yield Finding("crutd.connected", text, str(one.own.resource_id), context)
