"""What a decision needs to know: resources, lots, and who uses what."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import date
from typing import Any
from uuid import UUID

from labweb.domain.graph.attachments import Attachment
from labweb.domain.resources.contents_by_lot import Contents, LotId, Phase
from labweb.domain.resources.placement import Place, PlacedThing


@dataclass(frozen=True, slots=True, kw_only=True)
class ResourceState:
    """What a decision needs to know of one resource."""

    id: UUID
    name: str
    kind: str
    parent_id: UUID | None = None
    contents: Contents = field(default_factory=dict)
    """Nanolitres by lot: liquids."""

    masses: Contents = field(default_factory=dict)
    """Micrograms by lot: solids and gases."""

    knows_masses: bool = True
    """False for an edge host, which keeps no record of solids and gases."""

    capacity_nl: int | None = None
    """None: nobody stated it, so nothing may be poured in."""

    capacity_ug: int | None = None
    """The same for what is counted by mass."""

    dead_volume_nl: int = 0
    data: Mapping[str, Any] = field(default_factory=dict)
    quarantined_by: str | None = None
    """Transaction whose outcome nobody knows."""

    is_archived: bool = False
    there: tuple[PlacedThing, ...] = ()
    """What stands in it, where that has a say in what may come: `places.is_bounded`."""

    sites_count: int | None = None
    """How many things a rack or a carrier takes; None: nobody stated it."""

    ancestor_ids: tuple[UUID, ...] = ()


Snapshot = Mapping[UUID, ResourceState]


@dataclass(frozen=True, slots=True, kw_only=True)
class MaterialState:
    """What is listed about a substance; nothing is inferred from its name."""

    key: str
    name: str
    groups: frozenset[str] = frozenset()
    incompatible_with: frozenset[str] = frozenset()
    """Keys of materials and names of groups."""

    density_mg_ul: float | None = None
    """None: nobody stated it."""

    def is_incompatible_with(self, other: MaterialState) -> bool:
        """Tell whether one of the two lists the other, by its key or by a group of it."""
        return bool(
            self.incompatible_with & {other.key, *other.groups}
            or other.incompatible_with & {self.key, *self.groups}
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class LotState:
    """One delivery."""

    id: LotId
    name: str
    phase: Phase
    material: MaterialState
    expires_on: date | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """What is known beside the resources, by who has it: the server, under its locks."""

    on: date
    """Today, where the lab is."""

    lots: Mapping[LotId, LotState] = field(default_factory=dict)
    """Every lot that the touched vessels hold or the operation names."""

    material: MaterialState | None = None
    """The one that a delivery is of; None: there is none of that id."""

    materials: Mapping[UUID, MaterialState] = field(default_factory=dict)
    """Those that the products of a reaction are of."""

    taken_lots: frozenset[UUID] = frozenset()
    """Products whose id or key belongs to a lot already."""

    is_known_delivery: bool = False
    """A lot of this id or key, or of this material, supplier and number, was received."""

    is_taken: bool = False
    """A resource of the new one's id or key is there already."""

    taken_tubes: tuple[str, ...] = ()
    """Keys of tubes of a device that come, which connections have that stay."""

    attachments: tuple[Attachment, ...] = ()
    """What connects the thing that is to be carried, or what stands in it, with the rest; of parts
    of a device that go, what else than their own tubes."""

    inside: Snapshot = field(default_factory=dict)
    """What stands in the parts of a device that go, at any depth, and is no part of it."""

    places: tuple[Place, ...] = ()
    """Where parts of a device come to stand, without those that come themselves."""

    reserved: Mapping[UUID, str] = field(default_factory=dict)
    """Who has reserved a part that goes, and until when."""

    connection: tuple[str, ...] | None = None
    """One that is to be taken off, as it is: id, key, both ends with their ports, medium."""

    is_inside_of: str = ""
    """Device of which both of its ends are parts; "": none."""

    held: Mapping[UUID, str] = field(default_factory=dict)
    """Transaction that uses a resource now."""
