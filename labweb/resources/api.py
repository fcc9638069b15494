"""REST of the physical graph."""

from __future__ import annotations

from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import user_of
from labweb.common.lists import STANDING
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.graph.ports_and_connections import Medium
from labweb.resources import selectors
from labweb.resources.answers import ConnectionEnd, ConnectionList, ConnectionRow
from labweb.resources.models import Connection, Resource


class Connections(Endpoint):
    """What can flow or be carried where."""

    queries = STANDING.parameters

    def get(self, request: Request) -> ConnectionList:
        """List the connections between resources the caller may see."""
        seen = selectors.allowed_ids(user_of(request), Permission.VIEW)
        rows = selectors.connections_of(selectors.the_lab()).select_related("source", "target")
        rows = rows.filter(source_id__in=list(seen), target_id__in=list(seen))
        found, following = STANDING.of_rows(request, rows, "position", "key", "id")
        return ConnectionList(connections=[connection_row(row) for row in found], next=following)


def connection_row(row: Connection) -> ConnectionRow:
    """Say one edge."""
    return ConnectionRow(
        id=row.id,
        key=row.key,
        source=connection_end(row.source, row.source_port),
        target=connection_end(row.target, row.target_port),
        medium=Medium(row.medium),
        is_two_way=row.is_two_way,
        dead_volume_nl=row.dead_volume_nl,
    )


def connection_end(row: Resource, port: str) -> ConnectionEnd:
    """Say one end of an edge."""
    return ConnectionEnd(id=row.id, name=row.name, port=port)
