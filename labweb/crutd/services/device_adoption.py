"""Take a device up together with what it brings into the tree and the graph, or nothing of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from uuid import UUID, uuid5

import msgspec
from django.db.transaction import atomic

from labweb.accounts.selectors import User
from labweb.crutd.services.events import wait_for_others
from labweb.crutd.services.transaction_opening import lock_operation
from labweb.crutd.services.transactions import Settlement, settle
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd.operations import Create
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.errors import DefinitionError, Finding, PreconditionError, StateError
from labweb.domain.graph.device_parts import (
    DeviceComponent,
    Injection,
    InnerTube,
    injected,
    list_reasons,
)
from labweb.domain.graph.lab_file.resource_config import check_config
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.resources.placement import PlacedThing, check_arriving
from labweb.domain.resources.resource import Resource as ResourceData
from labweb.domain.resources.resource_kinds import KINDS
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.selectors import Device
from labweb.enrollment.services import WantedDevice
from labweb.resources import selectors as resource_selectors
from labweb.resources import services as resource_services
from labweb.resources.selectors.occupants import places_of


def adopt_candidate(
    candidate_id: UUID,
    wanted: WantedDevice,
    *,
    parent_id: UUID | None,
    typed: str,
    reason: str,
    actor: User,
) -> Device:
    """Make a device of a candidate, and where a place is named, its parts with it.

    Args:
        candidate_id: Which.
        wanted: What it is.
        parent_id: In what its parts are to stand; None: it acts through the resources that
            `wanted` names, or through none.
        typed: As `labweb.enrollment.services.take_up`.
        reason: What was checked.
        actor: Who says so.

    Raises:
        LabError: As `labweb.enrollment.services.take_up`.
        DefinitionError: Its driver brings nothing, or a setting does not fit the tree.
        StateError: `inject.has_parts`: it acts through resources already; `inject.exists`: the
            lab has a resource of one of the keys.
        LockedError: Somebody uses the parent just now.
        PreconditionError: The parent carries nothing, is archived or quarantined.

    Effect:
        Records what stands in the lab, empty; where it stands is unknown until somebody confirms
        it. Device, parts and the connections between them are written together or not at all.
    """
    if parent_id is None:
        return enrollment_services.take_up(
            candidate_id, wanted, typed=typed, reason=reason, actor=actor
        )
    enrollment_services.compare_code(candidate_id, typed=typed, reason=reason, actor=actor)
    return _adopt(candidate_id, wanted, parent_id, reason, actor)


@atomic
def _adopt(
    candidate_id: UUID, wanted: WantedDevice, parent_id: UUID, reason: str, actor: User
) -> Device:
    device = enrollment_services.take_up_compared(candidate_id, wanted, reason=reason, actor=actor)
    if device.nodes or wanted.nodes:
        text = f"{device.name} acts through resources already: they stay, or choose none of them"
        raise StateError(text, code="inject.has_parts")
    if not resource_selectors.rows([parent_id]).filter(lab=device.lab).exists():
        raise DefinitionError("choose where it is to stand", code="candidate.nodes")
    resource_selectors.require(actor, Permission.ADMIT, [parent_id])
    spec = msgspec.convert(device.driver.spec, DriverSpec)
    made = injected(spec, device.config, key=device.key, name=device.name)
    ids = _checked(device, made)
    first, *others = made.parts
    operation = Create(
        resource_id=ids[first.key],
        parent_id=parent_id,
        key=first.key,
        name=first.name,
        kind=first.kind,
        config=dict(first.config),
    )
    row = lock_operation(operation, lab=device.lab, targets=(), actor_id=actor.pk)
    nodes = [_node(part, ids, parent_id) for part in others]
    _check_fit([_node(first, ids, parent_id), *nodes], parent_id)
    links = [_link(tube, ids) for tube in made.tubes]
    settlement = Settlement(
        outcome=Outcome(kind=OutcomeKind.DONE),
        verification="assumed",
        message=f"{device.name} brought {len(made.parts)} resources with it",
        parts=[_told(node, place) for place, node in enumerate(nodes, start=1)],
        links=links,
    )
    settle(row.id, settlement)
    resource_services.create_nodes(
        device.lab, ((node, place) for place, node in enumerate(nodes, start=1))
    )
    tubes = [resource_services.connection_of(device.lab, link) for link in links]
    resource_services.create_links(tubes, [], [])
    enrollment_services.give_parts(device, {role: ids[key] for role, key in made.nodes.items()})
    return device


def _check_fit(resources: Sequence[ResourceData], parent_id: UUID) -> None:
    """See to it that each of several things that come together has room where it comes.

    Raises:
        PreconditionError: One has not; findings list each. The parent is locked by the caller.
    """
    arriving = [
        (PlacedThing(one.id, one.name, one.kind), one.parent_id)
        for one in resources
        if one.parent_id is not None
    ]
    findings = check_arriving(arriving, places_of([parent_id]).values())
    if findings:
        raise PreconditionError(findings[0].message, code=findings[0].code, findings=findings[:100])


def _checked(device: Device, made: Injection) -> dict[str, UUID]:
    """Return the ids of what is to be made, by key, once nothing speaks against it."""
    if not made.parts:
        why = "; ".join(list_reasons(msgspec.convert(device.driver.spec, DriverSpec)))
        text = (
            f"{device.driver.class_name} brings nothing into the tree{f' ({why})' if why else ''}: "
            "choose a resource that it acts through, or none"
        )
        raise DefinitionError(text, code="inject.nothing")
    findings = [
        one for part in made.parts for one in check_config(part.kind, part.config, part.key)
    ]
    if findings:
        raise DefinitionError(findings[0].message, code="inject.config", findings=findings)
    wait_for_others(device.lab)
    taken = resource_selectors.taken_keys(device.lab, [part.key for part in made.parts])
    keys = {_key(tube) for tube in made.tubes}
    links = resource_selectors.connections_of(device.lab).filter(key__in=keys)
    taken += links.values_list("key", flat=True)
    if taken:
        findings = [Finding("inject.exists", f"{key!r} is there already", key) for key in taken]
        text = f"{findings[0].message}: give the device another name"
        raise StateError(text, code="inject.exists", findings=findings[:100])
    return {part.key: uuid5(device.id, part.key) for part in made.parts}


def _key(tube: InnerTube) -> str:
    return f"{tube.source}_{tube.target}"


def _node(part: DeviceComponent, ids: Mapping[str, UUID], parent_id: UUID) -> ResourceData:
    return ResourceData(
        id=ids[part.key],
        key=part.key,
        name=part.name,
        kind=part.kind,
        nature=KINDS[part.kind].nature,
        parent_id=ids[part.inside] if part.inside else parent_id,
        config=part.config,
    )


def _told(node: ResourceData, position: int) -> dict[str, Any]:
    """Render a part for the event, from which the lab can be rebuilt."""
    return {
        "id": str(node.id),
        "parent_id": str(node.parent_id),
        "key": node.key,
        "name": node.name,
        "kind": node.kind,
        "pose": None,
        "config": dict(node.config),
        "position": position,
    }


def _link(tube: InnerTube, ids: Mapping[str, UUID]) -> dict[str, Any]:
    return {
        "id": str(uuid5(ids[tube.source], _key(tube))),
        "key": _key(tube),
        "source_id": str(ids[tube.source]),
        "source_port": tube.source_port,
        "target_id": str(ids[tube.target]),
        "target_port": tube.target_port,
        "medium": Medium.LIQUID.value,
    }
