"""What the door for deliveries answers with."""

from __future__ import annotations

from uuid import UUID

from labweb.common.answers import ApiAnswer


class DeliveredLot(ApiAnswer):
    """A lot that came, and how the other system calls it."""

    id: UUID
    key: str


class DeliveredLots(ApiAnswer):
    """Every lot of a delivery, in its order."""

    lots: list[DeliveredLot]
