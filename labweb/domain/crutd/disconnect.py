"""Preconditions for a connection to come off the physical graph."""

from __future__ import annotations

from collections.abc import Iterator

from labweb.domain.crutd.operations import Disconnect
from labweb.domain.crutd.snapshot import Facts, ResourceState, Snapshot
from labweb.domain.errors import Finding
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.resources.contents_by_lot import total_nl
from labweb.domain.resources.resource_kinds import KINDS, Nature
from labweb.domain.units import render_volume

DRY = frozenset({Medium.MECHANICAL, Medium.ELECTRICAL, Medium.COMMUNICATION, Medium.TRANSPORT})
"""Media in which nothing can stand. In any other, and in one that nobody named, it may."""


def check_disconnect(
    operation: Disconnect, snapshot: Snapshot, facts: Facts | None
) -> list[Finding]:
    """List what speaks against it: it is not there so, it is a device's own, it may hold matter.

    Args:
        operation: The connection, as the person saw it.
        snapshot: Its two ends.
        facts: What the server knows besides; an edge host takes nothing off.
    """
    findings = [] if facts is None else list(_check_there(operation, facts))
    if operation.medium in DRY:
        return findings
    for resource_id in sorted({operation.source_id, operation.target_id}):
        findings += _check_end(operation, snapshot[resource_id])
    if not operation.is_seen_empty:
        text = (
            f"nobody has seen that {operation.key} ({operation.medium}) is empty, and no record "
            "tells: look, empty it, and say so"
        )
        findings.append(Finding("crutd.not_seen_empty", text, operation.key))
    return findings


def _check_there(operation: Disconnect, facts: Facts) -> Iterator[Finding]:
    there = facts.connection
    if there is None or there != seen(operation):
        text = f"there is no connection {operation.key} as it was shown: look again"
        yield Finding("crutd.no_connection", text, operation.key)
    if facts.is_inside_of:
        text = (
            f"{operation.key} joins two parts of {facts.is_inside_of}: it goes with the device, or "
            "with a version of its driver that has no such tube"
        )
        yield Finding("crutd.own_connection", text, operation.key)


def seen(operation: Disconnect) -> tuple[str, ...]:
    """Return all that a person saw of the connection."""
    names = ("connection_id", "key", "source_id", "source_port", "target_id", "target_port")
    return tuple(str(getattr(operation, name)) for name in (*names, "medium"))


def _check_end(operation: Disconnect, state: ResourceState) -> Iterator[Finding]:
    """Refuse where an end that liquid only passes holds some: then it stands in the line."""
    kind, held_nl = KINDS.get(state.kind), total_nl(state.contents)
    if not held_nl or (kind is not None and kind.nature is Nature.RESOURCE):
        return
    yield Finding(
        "crutd.holds_matter",
        f"{state.name} holds {render_volume(held_nl)}, and {operation.key} leads out of it: empty "
        "it, or take stock of it",
        str(state.id),
        {"resource_id": str(state.id)},
    )
