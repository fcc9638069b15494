"""REST of the physical graph."""

from __future__ import annotations

from typing import Any

from rest_framework.request import Request
from rest_framework.response import Response

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import user_of
from labweb.common.lists import STANDING
from labweb.domain.approvals.roles import Permission
from labweb.resources import selectors
from labweb.resources.models import Connection, Resource


class Connections(Endpoint):
    """What can flow or be carried where."""

    queries = STANDING.parameters

    def get(self, request: Request) -> Response:
        """List the connections between resources the caller may see."""
        seen = selectors.allowed_ids(user_of(request), Permission.VIEW)
        rows = selectors.connections_of(selectors.the_lab()).select_related("source", "target")
        rows = rows.filter(source_id__in=list(seen), target_id__in=list(seen))
        found, following = STANDING.of_rows(request, rows, "position", "key", "id")
        return Response(
            {"connections": [render_connection(row) for row in found], "next": following}
        )


def render_connection(row: Connection) -> dict[str, Any]:
    """Render one edge."""
    return {
        "id": str(row.id),
        "key": row.key,
        "source": render_end(row.source, row.source_port),
        "target": render_end(row.target, row.target_port),
        "medium": row.medium,
        "is_two_way": row.is_two_way,
        "dead_volume_nl": row.dead_volume_nl,
    }


def render_end(row: Resource, port: str) -> dict[str, str]:
    """Render one end of an edge."""
    return {"id": str(row.id), "name": row.name, "port": port}
