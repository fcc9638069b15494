"""What goes over of each lot when a liquid is drawn."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import structs

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.resources.contents import Contents, LotId, add, remove, take, total_nl


def carried_parts(operation: TransferLiquid, moved_nl: int) -> dict[LotId, int]:
    """Return how much of each solid went along, in micrograms, when so much liquid moved.

    With less liquid goes the same share of each solid, rounded down; with more no more than was
    said, for of the rest it was said that it stays.

    Example:
        >>> from uuid import UUID
        >>> a, b = UUID(int=1), UUID(int=2)
        >>> whole = TransferLiquid(
        ...     source_id=a, target_id=b, amount_nl=1000, carries_ug={"salt": 500}
        ... )
        >>> carried_parts(whole, 250), carried_parts(whole, 1001)
        ({'salt': 125}, {'salt': 500})
    """
    moved_nl = min(moved_nl, operation.amount_nl)
    shares = {
        LotId(lot): part * moved_nl // operation.amount_nl
        for lot, part in operation.carries_ug.items()
    }
    return {lot: part for lot, part in shares.items() if part}


def rest_of(operation: TransferLiquid, moved_nl: int, part_nl: int) -> TransferLiquid:
    """Return the move of a further part, after a device has moved some and stopped.

    It takes its share of the lots and solids that are left; the last part takes all of them.

    Example:
        >>> from uuid import UUID
        >>> a, b = UUID(int=1), UUID(int=2)
        >>> whole = TransferLiquid(
        ...     source_id=a, target_id=b, amount_nl=1000, carries_ug={"salt": 501}
        ... )
        >>> rest_of(whole, 500, 500).carries_ug, rest_of(whole, 500, 100).carries_ug
        ({'salt': 251}, {'salt': 50})
    """
    rest_nl = max(operation.amount_nl - moved_nl, 0)
    lots = {LotId(lot): part for lot, part in operation.parts_nl.items()}
    lots = remove(lots, take(lots, min(moved_nl, total_nl(lots))))
    gone = carried_parts(operation, moved_nl)
    solids = {lot: ug - gone.get(LotId(lot), 0) for lot, ug in operation.carries_ug.items()}
    if part_nl < rest_nl:
        lots = take(lots, part_nl) if lots else lots
        solids = {lot: ug * part_nl // rest_nl for lot, ug in solids.items()}
    return structs.replace(
        operation,
        amount_nl=part_nl,
        parts_nl={str(lot): part for lot, part in lots.items()},
        carries_ug=solids,
    )


def drawn_parts(there: Contents, wanted: Mapping[str, int], moved_nl: int) -> dict[LotId, int]:
    """Return what went over of each lot when one layer was drawn.

    Less than was wanted is the same share of each lot of the layer; what is more came, well
    mixed, out of what lies next to it.

    Example:
        >>> brine, ether = LotId("brine"), LotId("ether")
        >>> drawn_parts({brine: 10, ether: 10}, {"brine": 10}, 12)
        {'brine': 10, 'ether': 2}
    """
    layer = {LotId(lot): part for lot, part in wanted.items() if part}
    if moved_nl <= total_nl(layer):
        return take(layer, moved_nl)
    return add(layer, take(remove(there, layer), moved_nl - total_nl(layer)))
