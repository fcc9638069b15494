"""What stands in a physical graph, and which of its ports it can join."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from labweb.domain.graph.ports_and_connections import Medium

NL_PER_ML = 1_000_000
NL_PER_UL = 1_000


class ElementRole(StrEnum):
    """What an element does with liquid."""

    VESSEL = "vessel"
    """Holds liquid: a transfer begins and ends here, and none leads through."""

    GAS = "gas"
    """Gives gas, takes nothing."""

    VALVE = "valve"
    """Joins two of its ports at a time: rotary, two-position or injection."""

    SOLENOID = "solenoid"
    """Joins its two ports while it is open."""

    PUMP = "pump"
    """A syringe. With a valve of its own it selects one of its ports."""

    MANIFOLD = "manifold"
    """Joins all of its ports, always."""

    CARTRIDGE = "cartridge"
    """Liquid flows through its filling."""

    VACUUM = "vacuum"
    """A vacuum line or pump: never given liquid."""

    OTHER = "other"
    """Touches no liquid, or nobody says that it may."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Element:
    """One thing of a physical graph."""

    key: str
    """Id in the file, by which actions name the device."""

    role: ElementRole
    kind: str = ""
    """Class in the file, for sentences."""

    common_port: str | None = None
    """Port that a rotary valve joins to one other; None: nobody says which."""

    ports: frozenset[str] | None = None
    """Ports that it has; None: as many as the tubes name."""

    numbered: bool = False
    """Only positions whose names are whole numbers from 1 can be turned to."""

    positions: Mapping[str, frozenset[frozenset[str]]] = field(default_factory=dict)
    """Of a two-position or injection valve: position → pairs of ports that it joins."""

    selects: bool = False
    """Of a pump: it has a valve of its own that selects one port."""

    capacity_nl: int | None = None
    """Of a pump: what its syringe holds. None: nobody says."""

    leave_by: str | None = None
    """Port that liquid leaves by when nobody asks for another."""

    enter_by: str | None = None
    """Port that liquid enters by when nobody asks for another."""

    attributes: Mapping[str, Any] = field(default_factory=dict)
    """Everything that the file says of it."""

    nl_per_unit: int = NL_PER_ML
    """What one unit of every volume in `attributes` is: 1 mL, or 1 µL (1000) of PyLabRobot."""

    def position(self, entered: str, left: str) -> str | None:
        """Return where a valve must stand to join two of its ports; None: it never does.

        Example:
            >>> six = Element(key="v", role=Role.VALVE, common_port="-1")
            >>> six.position("3", "-1"), six.position("3", "4")
            ('3', None)
        """
        if entered == left or not self.has_port(entered) or not self.has_port(left):
            return None
        pair = frozenset((entered, left))
        if self.positions:
            # A position that joins one of the two to a third port, too, would divide the flow.
            found = (
                name
                for name, pairs in self.positions.items()
                if pair in pairs and not any(other & pair for other in pairs - {pair})
            )
            return next(found, None)
        if self.common_port is None or self.common_port not in pair:
            return None
        other = left if entered == self.common_port else entered
        return None if self.numbered and not is_numbered(other) else other

    def has_port(self, port: str) -> bool:
        """Tell whether a tube can be joined to it at a port of that name."""
        return bool(port) and (self.ports is None or port in self.ports)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tube:
    """A directed edge between ports of two elements."""

    key: str
    source: str
    source_port: str
    target: str
    target_port: str
    medium: Medium
    is_two_way: bool
    dead_volume_nl: int | None = None
    attributes: Mapping[str, Any] = field(default_factory=dict)
    """Everything that the file says of it."""


def is_numbered(port: str) -> bool:
    """Tell whether a port name is the number of a valve position.

    Example:
        >>> is_numbered("3"), is_numbered("0"), is_numbered("common")
        (True, False, False)
    """
    return port.isascii() and port.isdigit() and not port.startswith("0")
