"""REST of the lineage of a lot or a vessel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar
from uuid import UUID

import msgspec
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import user_of
from labweb.common.requests import Parameter, one_of, whole_number, word
from labweb.crutd.answers import (
    LineageGraph,
)
from labweb.crutd.api.resources import visible
from labweb.crutd.selectors import lineage
from labweb.domain.approvals.role_permissions import Permission
from labweb.resources import selectors as resource_selectors

_DIRECTIONS = ("both", "up", "down")


_ELSEWHERE = "elsewhere"
"""Stands for the name of what the caller may not know of."""


class Lineage(Endpoint):
    """Where what is in a vessel came from, and where it went."""

    queries: ClassVar[Mapping[str, Parameter]] = {
        "direction": one_of(_DIRECTIONS),
        "depth": Parameter({"type": "integer", "minimum": 1, "maximum": lineage.DEEPEST}),
    }

    def get(self, request: Request, resource_id: UUID) -> LineageGraph:
        """Return the graph around a vessel, `direction` up, down or both, to `depth`."""
        row = visible(request, resource_id)
        direction = word(request, "direction", _DIRECTIONS)
        depth = whole_number(request, "depth", default=3, low=1, high=lineage.DEEPEST)
        told = lineage.lineage(row, direction=direction, depth=depth)
        graph = msgspec.convert(told, LineageGraph)
        seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
        for node in graph.nodes:
            if node.type == "vessel" and UUID(node.id) not in seen:
                node.name, node.detail = _ELSEWHERE, ""
        graph.unread = [one for one in graph.unread if one in seen]
        return graph
