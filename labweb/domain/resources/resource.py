"""One node of the resource tree."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from uuid import UUID

from labweb.domain.resources.pose import Pose
from labweb.domain.resources.resource_kinds import Nature


@dataclass(frozen=True, slots=True, kw_only=True)
class Resource:
    """Anything with an identity and a parent."""

    id: UUID
    key: str
    """Id in the lab file, unique within the lab; what links and fixtures name."""

    name: str
    """What a person reads."""

    kind: str
    nature: Nature
    parent_id: UUID | None
    pose: Pose | None = None
    """Relative to the parent; None is unknown."""

    size_mm: tuple[float, float, float] | None = None
    """Bounding box: x, y, z."""

    config: Mapping[str, Any] = field(default_factory=dict)
    """What is set by people: capacity_ul, dead_volume_ul, tare_mg, limits."""

    data: Mapping[str, Any] = field(default_factory=dict)
    """What the world last said: setpoints, port_index; contents live in the ledger."""

    extra: Mapping[str, Any] = field(default_factory=dict)
    """What an import carried and has no place here; kept for export."""
