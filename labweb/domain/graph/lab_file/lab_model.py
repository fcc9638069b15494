"""A whole lab as a file describes it, before anything of it is stored."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Any
from uuid import UUID, uuid5

from labweb.domain.errors import Finding
from labweb.domain.graph.ports_and_connections import Connection, PhysicalGraph
from labweb.domain.resources.contents_by_lot import LotId, Phase
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_tree import Tree

UNI_LAB_OS = "uni_lab_os"
"""Name of that format, and of its place in `extra`."""

LAB_NAMESPACE = UUID("5f6f6f2c-3f0b-5d0e-9a53-0c5b8e0d7a11")
"""Namespace under which the name of a lab becomes its id."""


class LabMode(StrEnum):
    """Whether the devices of a lab are real. The two never mix in one lab."""

    SIM = "sim"
    """Every device is driven against a simulated instrument."""

    LIVE = "live"
    """Every device is driven against hardware."""


def lab_id(name: str) -> UUID:
    """Return the id of the lab of that name; the same name always gives the same id."""
    return uuid5(LAB_NAMESPACE, name)


def entry_id(lab: UUID, sort: str, key: str) -> UUID:
    """Return the id of one entry: UUIDv5 of the lab, the sort of entry and its key."""
    return uuid5(lab, f"{sort}/{key}")


@dataclass(frozen=True, slots=True, kw_only=True)
class LabFileMaterial:
    """A chemical identity."""

    id: UUID
    key: str
    name: str
    inchikey: str | None = None
    density_mg_ul: float | None = None
    """None is unknown; nobody may fill it in by guess."""

    concentration_mmol_l: float | None = None
    """How much of the substance it is named for is in a litre of it, pure or dissolved. None is
    unknown: no yield is reckoned on it."""

    ph: float | None = None
    hazards: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()
    """Sorts of substance, as people name them: `acid`, `oxidizer`."""

    incompatible_with: tuple[str, ...] = ()
    """Keys of materials and names of groups that it must never meet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LabFileLot:
    """One delivery of a material."""

    id: UUID
    key: str
    material_id: UUID
    supplier: str | None = None
    number: str | None = None
    expires_on: str | None = None
    """Date as `YYYY-MM-DD`."""

    purity: str | None = None
    phase: Phase = Phase.LIQUID


@dataclass(frozen=True, slots=True, kw_only=True)
class HostEntry:
    """A machine that owns devices."""

    id: UUID
    key: str
    name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LabFileSimulator:
    """The simulated instrument that stands in for a device."""

    model: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    line: str | None = None
    """Devices that name the same line share one carrier; None is a line of its own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceEntry:
    """One instrument, its driver, and the nodes it acts through."""

    id: UUID
    key: str
    name: str
    host_id: UUID
    driver: str
    """`module:Class`."""

    config: Mapping[str, Any] = field(default_factory=dict)
    nodes: Mapping[str, UUID] = field(default_factory=dict)
    """Role in the driver → resource."""

    transport: str | None = None
    """URL of the byte carrier; None when a simulator stands in."""

    simulator: LabFileSimulator | None = None

    @property
    def line(self) -> str:
        """Return what the device shares a carrier by: URL, line of the simulator, or key."""
        if self.simulator is None:
            return (self.transport or self.key).partition("?")[0]
        return self.simulator.line or self.key

    @property
    def address(self) -> str | None:
        """Return what tells the device from others on its line; None when nothing does."""
        settings = self.simulator.settings if self.simulator else {}
        for known in (self.config, settings):
            for name in ("address", "device_id"):
                if known.get(name) is not None:
                    return str(known[name])
        return (self.transport or "").partition("?")[2] or None


@dataclass(frozen=True, kw_only=True)
class LabFile:
    """Everything that a lab file says, checked as a whole."""

    id: UUID
    name: str
    time_zone: str
    mode: LabMode
    materials: tuple[LabFileMaterial, ...] = ()
    lots: tuple[LabFileLot, ...] = ()
    resources: tuple[Resource, ...] = ()
    contents: Mapping[UUID, Mapping[LotId, int]] = field(default_factory=dict)
    """Resource → lot id as text → nanolitres. Empty vessels are not listed."""

    masses: Mapping[UUID, Mapping[LotId, int]] = field(default_factory=dict)
    """Resource → lot id as text → micrograms, for solids and gases."""

    connections: tuple[Connection, ...] = ()
    hosts: tuple[HostEntry, ...] = ()
    devices: tuple[DeviceEntry, ...] = ()
    discovered: tuple[str, ...] = ()
    """Keys of devices that were found and that nobody has admitted yet."""

    extra: Mapping[str, Any] = field(default_factory=dict)
    """What an import carried beside nodes and links; kept for export."""

    notes: tuple[Finding, ...] = field(default=(), compare=False)
    """What a reader should know about an import; not part of the lab."""

    @cached_property
    def tree(self) -> Tree:
        """The resources as a tree."""
        return Tree(self.resources)

    @cached_property
    def graph(self) -> PhysicalGraph:
        """The connections as a graph."""
        return PhysicalGraph(self.connections)

    @cached_property
    def lots_by_id(self) -> Mapping[LotId, LabFileLot]:
        """Lot by its id as text."""
        return {LotId(str(lot.id)): lot for lot in self.lots}

    @cached_property
    def materials_by_id(self) -> Mapping[UUID, LabFileMaterial]:
        """Material by id."""
        return {material.id: material for material in self.materials}
