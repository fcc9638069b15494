"""A rig: the physical graph of one lab, as a file draws it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Any

from labweb.domain.errors import Finding
from labweb.domain.graph.elements import Element, ElementRole, Tube
from labweb.domain.graph.port_network import Network


class RigFormat(StrEnum):
    """A format of physical graphs."""

    NODE_LINK = "node_link"
    """JSON of nodes and links: Chemputer and Uni-Lab-OS graphs."""

    GRAPHML = "graphml"
    """GraphML, plain or as yEd writes it."""

    LABWEB = "labweb"
    """labweb's own `lab.json`."""


@dataclass(frozen=True)
class Rig:
    """Elements, tubes, and what is wrong with single tubes."""

    format: RigFormat
    elements: tuple[Element, ...]
    tubes: tuple[Tube, ...]
    defects: tuple[Finding, ...] = ()
    """Tubes at ports that do not exist: kept for writing, never routed."""

    top: Mapping[str, Any] = field(default_factory=dict)
    """What the file says beside its nodes and links."""

    text: str | None = None
    """The document itself where the model does not hold all of it (GraphML)."""

    @cached_property
    def pumps(self) -> frozenset[str]:
        """Return the keys of what pumps liquid."""
        return frozenset(one.key for one in self.elements if one.role is ElementRole.PUMP)

    @cached_property
    def network(self) -> Network:
        """Return what conducts liquid, without the tubes at ports that do not exist."""
        bad = {finding.subject for finding in self.defects}
        return Network(self.elements, [tube for tube in self.tubes if tube.key not in bad])
