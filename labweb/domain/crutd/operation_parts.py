"""What operations are made of: amounts of lots, and connections."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

import msgspec
from msgspec import Meta

from labweb.domain.resources.contents_by_lot import Phase

Amount = Annotated[int, Meta(ge=0, le=999_999_999_999_999)]
"""Whole nanolitres or micrograms: at most a cubic metre, or a tonne."""

Difference = Annotated[int, Meta(ge=-999_999_999_999_999, le=999_999_999_999_999)]
"""The same, read before it is known to be an amount: what is not above zero is refused by name."""

Name = Annotated[str, Meta(min_length=1, max_length=500)]
Text = Annotated[str, Meta(max_length=500)]


class Portion(msgspec.Struct, frozen=True, kw_only=True):
    """What of a delivery comes into one vessel: in the unit of its phase."""

    resource_id: UUID
    amount_nl: Amount = 0
    amount_ug: Amount = 0


class ReactantShare(msgspec.Struct, frozen=True, kw_only=True):
    """What a reaction consumed of one lot: in the unit that the lot is counted in."""

    lot_id: UUID
    amount_nl: Amount = 0
    amount_ug: Amount = 0
    mass_ug: Amount | None = None
    """What it weighs; needed for a liquid of which nobody stated the density."""


class Product(msgspec.Struct, frozen=True, kw_only=True):
    """A new lot that a reaction made, in the unit of its phase."""

    lot_id: UUID
    material_id: UUID
    key: Name
    phase: Phase
    amount_nl: Amount = 0
    amount_ug: Amount = 0
    mass_ug: Amount | None = None
    number: Text = ""
    purity: Text = ""


class Joint(msgspec.Struct, frozen=True, kw_only=True):
    """A connection between two ports."""

    id: UUID
    key: Name
    source_id: UUID
    source_port: Text
    target_id: UUID
    target_port: Text
    medium: Text
