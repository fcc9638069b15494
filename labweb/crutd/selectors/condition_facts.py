"""What the server knows beside the resources: lots, materials, today, and who uses what."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import date
from types import MappingProxyType
from uuid import UUID, uuid5
from zoneinfo import ZoneInfo

from labweb.common.clock import now
from labweb.crutd.selectors import held_locks, snapshot
from labweb.crutd.selectors.device_parts import joins_parts_of
from labweb.crutd.selectors.reservations import reservations_on
from labweb.domain.crutd import operations
from labweb.domain.crutd.event_replay import link
from labweb.domain.crutd.snapshot import Facts, LotState, MaterialState, ResourceState
from labweb.domain.resources.contents_by_lot import LotId, Phase
from labweb.domain.runs.exclusive_use.action_locks import conflicts, lock_set
from labweb.domain.runs.exclusive_use.run_holds import ROOMY
from labweb.domain.runs.exclusive_use.run_holds import places_of as places_in
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab, Lot, Material
from labweb.resources.selectors.occupants import places_of


def today(lab: Lab) -> date:
    """Return the date where the lab is."""
    return now().astimezone(ZoneInfo(lab.time_zone)).date()


def facts_for(
    operation: operations.Operation,
    lab: Lab,
    states: Mapping[UUID, ResourceState],
    known: Mapping[LotId, Lot] = MappingProxyType({}),
) -> Facts:
    """Return what a check needs; a query for unknown lots, two for a new or a carried thing."""
    receive = operation if isinstance(operation, operations.Receive) else None
    create = operation if isinstance(operation, operations.Create) else None
    react = operation if isinstance(operation, operations.React) else None
    carried = operation if isinstance(operation, operations.TransferResource) else None
    if isinstance(operation, operations.Refit):
        return _refit_facts(operation, lab)
    if isinstance(operation, operations.Disconnect):
        return _link_facts(operation, lab)
    if isinstance(operation, operations.Delete):
        return _leaving_facts(operation, lab)
    wanted = {lot for state in states.values() for lot in (*state.contents, *state.masses)}
    if isinstance(operation, operations.Correct):
        wanted |= {LotId(lot) for lot in (*operation.measured_nl, *operation.measured_ug)}
    material = None if receive is None else resource_selectors.find_material(receive.material_id)
    return Facts(
        on=today(lab),
        lots=_lots({lot for lot in wanted if _is_id(lot)}, known),
        material=None if material is None or material.lab_id != lab.id else _material(material),
        materials={}
        if react is None
        else {
            row.id: _material(row)
            for row in resource_selectors.materials_of(lab).filter(
                pk__in=[product.material_id for product in react.products]
            )
        },
        taken_lots=frozenset()
        if react is None
        else resource_selectors.taken_lots(lab, react.products),
        attachments=()
        if carried is None
        else resource_selectors.attachments_of(carried.resource_id),
        is_known_delivery=receive is not None
        and resource_selectors.is_known_delivery(lab, receive),
        is_taken=create is not None
        and resource_selectors.is_taken(lab, create.resource_id, create.key),
    )


def _refit_facts(refit: operations.Refit, lab: Lab) -> Facts:
    """Return what a device's parts that go would leave hanging, and what stands in them."""
    gone = resource_selectors.descendants(refit.gone) if refit.gone else set()
    within = resource_selectors.rows(gone.difference(refit.gone)).exclude(kind="slot")
    own = {row.id for row in within if row.id == uuid5(refit.device_id, row.key)}
    """Holders that came with the device, and go with the part that they are in."""
    inside = within.exclude(pk__in=own)
    keys = {create.key for create in refit.added}
    ids = [create.resource_id for create in refit.added]
    parents = {create.parent_id for create in refit.added} | set(refit.back.values())
    return Facts(
        on=today(lab),
        attachments=resource_selectors.hanging(refit, gone),
        inside=snapshot(inside),
        places=tuple(places_of(parents.difference(ids)).values()) if parents else (),
        reserved={
            row.resource_id: f"by {row.holder.printed_name}: {row.reason}"
            for row in reservations_on(lab, gone)
        },
        is_taken=bool(resource_selectors.taken_keys(lab, keys))
        or resource_selectors.rows(ids).exists(),
        taken_tubes=resource_selectors.taken_tubes(lab, refit),
    )


def _leaving_facts(delete: operations.Delete, lab: Lab) -> Facts:
    """Return what is connected to a thing that is archived, and what stands in it.

    A tube between two parts of one device goes with them, and holds neither back, whichever of
    them is archived first.
    """
    attachments = resource_selectors.attachments_of(delete.resource_id)
    others = {one.other.resource_id for one in attachments}
    gone = set(
        resource_selectors.rows(others).filter(is_archived=True).values_list("pk", flat=True)
    )
    within = resource_selectors.descendants([delete.resource_id]) - {delete.resource_id}
    return Facts(
        on=today(lab),
        attachments=tuple(
            one
            for one in attachments
            if one.other.resource_id not in gone
            and not joins_parts_of(lab, one.own.resource_id, one.other.resource_id)
        ),
        inside=snapshot(resource_selectors.rows(within)) if within else {},
    )


def _link_facts(disconnect: operations.Disconnect, lab: Lab) -> Facts:
    """Return the connection as it is, and the device whose inner one it is."""
    rows = resource_selectors.connections_of(lab).filter(pk=disconnect.connection_id)
    there = next(iter(resource_selectors.to_graph(rows).connections), None)
    return Facts(
        on=today(lab),
        connection=None if there is None else tuple(link(there).values()),
        is_inside_of=joins_parts_of(lab, disconnect.source_id, disconnect.target_id),
    )


def lab_facts(lab: Lab, lots: Iterable[Lot], materials: Iterable[Material]) -> Facts:
    """Return all the lots and materials of a lab as facts, for compiling a workflow."""
    return Facts(
        on=today(lab),
        lots={LotId(str(row.id)): _lot(row) for row in lots},
        materials={row.id: _material(row) for row in materials},
    )


def holders(operation: operations.Operation) -> dict[UUID, str]:
    """Return the transaction that uses each touched resource now, or something it stands in."""
    ids = set(operations.touched_ids(operation))
    above = resource_selectors.ancestors(ids)
    locks = held_locks({*ids, *(node for nodes in above.values() for node in nodes)})
    kinds = dict(resource_selectors.rows(places_in(operation)).values_list("id", "kind"))
    roomy = {node for node, kind in kinds.items() if kind in ROOMY}
    found: dict[UUID, str] = {}
    for resource_id in ids:
        wanted = lock_set([resource_id], above, roomy)
        blocked = conflicts(wanted, [lock for lock, _ in locks])
        owners = [str(owner) for lock, owner in locks if lock.resource_id in blocked]
        if owners:
            found[resource_id] = owners[0]
    return found


def _is_id(text: str) -> bool:
    try:
        return str(UUID(text)) == text
    except ValueError:
        return False


def _lots(ids: set[LotId], known: Mapping[LotId, Lot]) -> dict[LotId, LotState]:
    found = {lot: _lot(known[lot]) for lot in ids if lot in known}
    missing = ids - known.keys()
    if missing:
        rows = resource_selectors.find_lots(missing)
        found |= {LotId(str(row.id)): _lot(row) for row in rows}
    return found


def _lot(row: Lot) -> LotState:
    return LotState(
        id=LotId(str(row.id)),
        name=str(row),
        phase=Phase(row.phase),
        material=_material(row.material),
        expires_on=row.expires_on,
    )


def _material(row: Material) -> MaterialState:
    return MaterialState(
        key=row.key,
        name=row.name,
        groups=frozenset(row.groups),
        incompatible_with=frozenset(row.incompatible_with),
        density_mg_ul=row.density_mg_ul,
    )
