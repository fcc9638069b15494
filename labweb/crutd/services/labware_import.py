"""Bring a piece of labware into a lab: one Create, its wells in bulk, or nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from django.db.transaction import atomic

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.crutd import selectors
from labweb.crutd.models import Transaction
from labweb.crutd.services.transaction_opening import lock_operation
from labweb.crutd.services.transactions import Settlement, settle
from labweb.domain.crutd.operations import Create
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.domain.errors import DefinitionError, Finding, StateError
from labweb.domain.resources.resource import Resource as ResourceData
from labweb.resources import selectors as resource_selectors
from labweb.resources import services as resource_services
from labweb.resources.selectors import Lab


@atomic
def import_labware(
    resources: Sequence[ResourceData], *, lab: Lab, actor: User | None, source: Mapping[str, str]
) -> Transaction:
    """Write labware that was read and checked as a whole.

    Args:
        resources: The labware first, then what lies in it, parents first.
        lab: Where the labware goes; its parent is a resource of it.
        actor: Who does it; None is the command line.
        source: File, format and digest, for the audit.

    Raises:
        DefinitionError: There is nothing to import.
        StateError: `labware.exists`: the lab has a resource of one of the keys.
        LockedError: Somebody uses the parent just now.
        PreconditionError: The parent carries nothing, is archived or quarantined.

    Effect:
        Records what stands in the lab; where it stands is unknown until somebody confirms it.
        Nothing is written when anything of it is refused.
    """
    if not resources:
        raise DefinitionError("there is no labware in the file", code="labware.invalid")
    _check_keys(resources, lab)
    first, *inside = resources
    if first.parent_id is None:
        raise DefinitionError("labware needs something to stand in", code="labware.invalid")
    operation = Create(
        resource_id=first.id,
        parent_id=first.parent_id,
        key=first.key,
        name=first.name,
        kind=first.kind,
        config=dict(first.config),
    )
    row = lock_operation(
        operation, lab=lab, targets=(), actor_id=None if actor is None else actor.pk
    )
    message = f"imported {len(resources)} resources from {source.get('file', 'a file')}"
    settle(
        row.id,
        Settlement(
            outcome=Outcome(kind=OutcomeKind.DONE),
            verification="assumed",
            message=message,
            parts=[_part(node, position) for position, node in enumerate(inside, start=1)],
        ),
    )
    resource_services.set_size(first.id, first.size_mm)
    bare = (replace(node, data={}, extra={}) for node in inside)
    resource_services.create_nodes(lab, ((node, place) for place, node in enumerate(bare, start=1)))
    account_services.write_audit("labware.import", str(first.id), actor=actor, detail=dict(source))
    return selectors.find_transaction(row.id)


def _part(node: ResourceData, position: int) -> dict[str, Any]:
    """Render what lies in labware for its event, from which the lab can be rebuilt."""
    return {
        "id": str(node.id),
        "parent_id": str(node.parent_id),
        "key": node.key,
        "name": node.name,
        "kind": node.kind,
        "pose": None if node.pose is None else node.pose.to_json(),
        "config": dict(node.config),
        "position": position,
    }


def _check_keys(resources: Sequence[ResourceData], lab: Lab) -> None:
    taken = resource_selectors.taken_keys(lab, [resource.key for resource in resources])
    if taken:
        findings = [Finding("labware.exists", f"{key!r} is there already", key) for key in taken]
        raise StateError(findings[0].message, code="labware.exists", findings=findings[:100])
