"""What goes over of each lot when a liquid is drawn."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import structs

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.resources.contents_by_lot import Contents, LotId, add, remove, take, total_nl


def part_of(move: TransferLiquid, part_nl: int) -> TransferLiquid:
    """Return a part of a move, with its share of the lots and solids that are stated.

    A solid's share is rounded down to the microgram; all of the move, or more, takes all of them.

    Example:
        >>> from uuid import UUID
        >>> a, b = UUID(int=1), UUID(int=2)
        >>> whole = TransferLiquid(
        ...     source_id=a, target_id=b, amount_nl=1000, carries_ug={"salt": 501}
        ... )
        >>> part_of(whole, 500).carries_ug, part_of(whole, 1001).carries_ug
        ({'salt': 250}, {'salt': 501})
    """
    if part_nl >= move.amount_nl:
        return structs.replace(move, amount_nl=part_nl)
    lots = {LotId(lot): nl for lot, nl in move.parts_nl.items()}
    lots = take(lots, part_nl) if lots else lots
    return structs.replace(
        move,
        amount_nl=part_nl,
        parts_nl={str(lot): nl for lot, nl in lots.items()},
        carries_ug={lot: ug * part_nl // move.amount_nl for lot, ug in move.carries_ug.items()},
    )


def rest_of(move: TransferLiquid, moved_nl: int) -> TransferLiquid:
    """Return what is left of a move once so much has moved, down to nothing.

    Example:
        >>> from uuid import UUID
        >>> a, b = UUID(int=1), UUID(int=2)
        >>> whole = TransferLiquid(
        ...     source_id=a, target_id=b, amount_nl=1000, carries_ug={"salt": 501}
        ... )
        >>> rest_of(whole, 500).carries_ug
        {'salt': 251}
    """
    gone = part_of(move, min(moved_nl, move.amount_nl))
    lots = {LotId(lot): nl for lot, nl in move.parts_nl.items()}
    lots = remove(lots, {LotId(lot): nl for lot, nl in gone.parts_nl.items()})
    return structs.replace(
        move,
        amount_nl=move.amount_nl - gone.amount_nl,
        parts_nl={str(lot): nl for lot, nl in lots.items()},
        carries_ug={lot: ug - gone.carries_ug[lot] for lot, ug in move.carries_ug.items()},
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
