"""Frozen states of resources, for a decision."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any
from uuid import UUID

from django.contrib.postgres.fields import ArrayField
from django.db.models import F, UUIDField

from labweb.common.database.prepared_queries import (
    Given,
    IsAnyOf,
    Prepared,
)
from labweb.crutd.models import Holding
from labweb.crutd.selectors.amounts import amounts, amounts_by_vessel
from labweb.domain.crutd.ledger import Amount
from labweb.domain.crutd.settlement import ResourceState
from labweb.domain.resources.contents_by_lot import LotId
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Above, Lot, Resource

_NOTHING: Mapping[LotId, Amount] = {}


def state_of(
    row: Resource,
    held: Mapping[LotId, Amount],
    above: tuple[UUID, ...] = (),
    *,
    is_archived: bool = False,
) -> ResourceState:
    """Turn a row and its contents into what a decision needs."""
    return ResourceState(
        id=row.id,
        name=row.name,
        kind=row.kind,
        parent_id=row.parent_id,
        contents={lot: amount.nl for lot, amount in held.items() if amount.nl},
        masses={lot: amount.ug for lot, amount in held.items() if amount.ug},
        capacity_nl=capacity_nl_of(row),
        capacity_ug=_thousandfold(row.config.get("capacity_mg")),
        dead_volume_nl=_thousandfold(row.config.get("dead_volume_ul")) or 0,
        data=row.data,
        quarantined_by=None if row.quarantined_by is None else str(row.quarantined_by),
        is_archived=row.is_archived or is_archived,
        ancestor_ids=above,
    )


def _thousandfold(value: object) -> int | None:
    """Return a figure of a config in the finer unit; what is no number states nothing.

    What came from elsewhere and was kept as it was (`foreign`) may say anything.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return round(value * 1000)


def capacity_nl_of(row: Resource) -> int | None:
    """Return how much liquid a resource holds; None: nobody stated it."""
    return _thousandfold(row.config.get("capacity_ul"))


def snapshot(rows: Iterable[Resource]) -> dict[UUID, ResourceState]:
    """Return the frozen state of the rows for a decision; two queries."""
    nodes = list(rows)
    above = resource_selectors.ancestors_and_archived(row.id for row in nodes)
    return _states(nodes, amounts(row.id for row in nodes), above)


def snapshot_and_lots(
    rows: Collection[Resource], known: Above
) -> tuple[dict[UUID, ResourceState], dict[LotId, Lot]]:
    """Return the state of rows whose way up is known, and the lots they hold; one query."""
    return states_and_lots(rows, known, HELD.rows(ids=[row.id for row in rows]))


def states_and_lots(
    rows: Collection[Resource], known: Above, holdings: Iterable[Holding]
) -> tuple[dict[UUID, ResourceState], dict[LotId, Lot]]:
    """Return the same of rows whose holdings were read by `HELD`."""
    held: dict[UUID, dict[LotId, Amount]] = {}
    lots: dict[LotId, Lot] = {}
    for holding in holdings:
        if holding.amount_nl or holding.amount_ug:
            lot = LotId(str(holding.lot_id))
            lots[lot] = holding.lot
            amount = Amount(holding.amount_nl, holding.amount_ug)
            held.setdefault(holding.resource_id, {})[lot] = amount
    return _states(rows, held, known), lots


HELD = Prepared(
    lambda: Holding.objects.filter(
        IsAnyOf(F("resource_id"), Given("ids", ArrayField(UUIDField())))
    ).select_related("lot__material")
)


def snapshot_in_place(rows: Collection[Resource]) -> dict[UUID, ResourceState]:
    """Return the state of rows without where they stand, for a view or a settlement; one query."""
    return _states(rows, amounts(row.id for row in rows), ({}, set()))


def _states(
    rows: Iterable[Resource], held: Mapping[UUID, Mapping[LotId, Amount]], known: Above
) -> dict[UUID, ResourceState]:
    above, archived = known
    return {
        row.id: state_of(
            row, held.get(row.id, _NOTHING), above.get(row.id, ()), is_archived=row.id in archived
        )
        for row in rows
    }


def lab_snapshot(
    rows: Collection[Resource], told: Iterable[tuple[Any, ...]] | None = None
) -> dict[UUID, ResourceState]:
    """Return the state of all the nodes of a lab, for compiling a workflow.

    Args:
        rows: The nodes.
        told: What `asking_amounts` has found; None reads it in one query.
    """
    held = amounts(row.id for row in rows) if told is None else amounts_by_vessel(told)
    parents = {row.id: row.parent_id for row in rows}
    closed = {row.id for row in rows if row.is_archived}
    found = {}
    for row in rows:
        above = tuple(_climb(row.id, parents))
        is_archived = not closed.isdisjoint(above)
        found[row.id] = state_of(row, held.get(row.id, _NOTHING), above, is_archived=is_archived)
    return found


def _climb(node: UUID, parents: dict[UUID, UUID | None]) -> Iterable[UUID]:
    parent = parents[node]
    while parent is not None:
        yield parent
        parent = parents[parent]
