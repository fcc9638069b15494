"""Ports and connections, each with a medium."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Any
from uuid import UUID


class Medium(StrEnum):
    """What a connection carries."""

    LIQUID = "liquid"
    GAS = "gas"
    VACUUM = "vacuum"
    THERMAL = "thermal"
    MECHANICAL = "mechanical"
    ELECTRICAL = "electrical"
    COMMUNICATION = "communication"
    TRANSPORT = "transport"
    OTHER = "other"
    """A link of a foreign file whose medium nobody mapped: kept, never routed."""


@dataclass(frozen=True, slots=True, order=True)
class PortRef:
    """One port of one resource. An empty name means the file named none."""

    resource_id: UUID
    port: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Connection:
    """A directed edge between two ports."""

    id: UUID
    key: str
    """Id in the lab file."""

    source: PortRef
    target: PortRef
    medium: Medium
    is_two_way: bool = True
    """A plain tube conducts both ways; a check valve does not."""

    dead_volume_nl: int | None = None
    """None is unknown: it costs nothing in routing and is listed in the plan."""

    extra: Mapping[str, Any] = field(default_factory=dict)
    """What an import carried and has no place here; kept for export."""


@dataclass(frozen=True)
class PhysicalGraph:
    """All connections of one lab."""

    connections: tuple[Connection, ...]

    @cached_property
    def by_resource(self) -> dict[UUID, list[Connection]]:
        """Connections that touch a resource."""
        found: dict[UUID, list[Connection]] = {}
        for connection in self.connections:
            found.setdefault(connection.source.resource_id, []).append(connection)
            if connection.target.resource_id != connection.source.resource_id:
                found.setdefault(connection.target.resource_id, []).append(connection)
        return found

    @cached_property
    def liquid(self) -> PhysicalGraph:
        """The graph of what liquid flows through alone."""
        return self.restricted(Medium.LIQUID)

    @cached_property
    def kept(self) -> dict[Hashable, Any]:
        """What was worked out of this graph already, by whoever asks; it lives as long."""
        return {}

    def restricted(self, medium: Medium) -> PhysicalGraph:
        """Return the graph of one medium alone."""
        return PhysicalGraph(tuple(c for c in self.connections if c.medium is medium))

    def neighbours(self, resource_id: UUID) -> Iterator[tuple[str, PortRef, Connection]]:
        """Yield (own port, far port, connection) for each way out of a resource."""
        for connection in self.by_resource.get(resource_id, ()):
            if connection.source.resource_id == resource_id:
                yield connection.source.port, connection.target, connection
            elif connection.is_two_way:
                yield connection.target.port, connection.source, connection
