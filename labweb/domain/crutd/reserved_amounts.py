"""What an operation promises on both sides before anything moves."""

from __future__ import annotations

from dataclasses import dataclass

from labweb.domain.crutd.operations import Operation, TransferLiquid, TransferMass


@dataclass(frozen=True, slots=True)
class Reservation:
    """An amount promised on both sides before anything moves; its lots are not known yet."""

    debit: str
    credit: str
    amount_nl: int = 0
    amount_ug: int = 0


def reservations(operation: Operation) -> tuple[Reservation, ...]:
    """Return what an operation reserves while it is under way."""
    if not isinstance(operation, TransferLiquid | TransferMass):
        return ()
    source, target = str(operation.source_id), str(operation.target_id)
    if isinstance(operation, TransferLiquid):
        liquid = Reservation(source, target, amount_nl=operation.amount_nl)
        carried_ug = sum(operation.carries_ug.values())
        solids = (Reservation(source, target, amount_ug=carried_ug),) if carried_ug else ()
        return (liquid, *solids)
    return (Reservation(source, target, amount_ug=operation.amount_ug),)
