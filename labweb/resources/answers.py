"""What the endpoints of the physical graph answer with."""

from __future__ import annotations

from uuid import UUID

from labweb.common.answers import ApiAnswer
from labweb.domain.graph.ports_and_connections import Medium


class ConnectionEnd(ApiAnswer):
    """The resource at one end of a connection, and its port."""

    id: UUID
    name: str
    port: str


class ConnectionRow(ApiAnswer):
    """One connection of the physical graph."""

    id: UUID
    key: str
    source: ConnectionEnd
    target: ConnectionEnd
    medium: Medium
    is_two_way: bool
    dead_volume_nl: int | None


class ConnectionList(ApiAnswer):
    """A page of connections."""

    connections: list[ConnectionRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""
