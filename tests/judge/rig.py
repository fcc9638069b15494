"""A liquid rig as its graph file draws it: devices, hoses between their ports, and faults.

    flask ──── 2 valve common ──── pump

A *hose* joins two ends; an end is a device and the name of one of its ports. A hose carries
liquid both ways, or one way only where a directed graph draws one direction only. Links of other
media are kept apart: no liquid runs there, yet a plan that tries it can be told why.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

End = tuple[str, str]
"""A device id and the name of one of its ports; the name is empty where the file has none."""


class Kind(StrEnum):
    """What a node is to a liquid."""

    VESSEL = "vessel"
    """Holds liquid and never passes it on by itself."""
    VALVE = "valve"
    """Rotary: joins its common port with one outer port at a time, and nothing else."""
    PUMP = "pump"
    """A syringe. All its hoses meet at the barrel: none can be shut off by the pump."""
    PUMP_VALVE = "pump_valve"
    """A syringe with a rotary valve in one housing; the barrel is the common port."""
    SOLENOID = "solenoid"
    """Joins its two ends when open; shut until told to open."""
    OTHER = "other"
    """Anything else: gas, vacuum, cartridges, stirrers. No liquid may go there."""


@dataclass(frozen=True)
class Device:
    """One node of the graph."""

    id: str
    kind: Kind
    class_name: str = ""
    capacity_nl: int | None = None
    """Volume of the syringe; None: the file does not say, and the pump is not used."""
    common: str = ""
    """Name of the common port of a valve."""
    declared: frozenset[str] = frozenset()
    """Outer ports that the device has whether or not a hose is on them."""


@dataclass(frozen=True)
class Hose:
    """A tube between two ends."""

    a: End
    b: End
    is_forward: bool = True
    """Liquid may run from a to b."""
    is_backward: bool = True
    """Liquid may run from b to a."""

    def other(self, end: End) -> End:
        """Return the far end."""
        return self.b if end == self.a else self.a

    def carries(self, start: End) -> bool:
        """Tell whether liquid may run out of this end into the hose."""
        return self.is_forward if start == self.a else self.is_backward


@dataclass(frozen=True)
class DryLink:
    """A link on which no liquid runs."""

    a: End
    b: End
    medium: str


@dataclass
class Rig:
    """All that the judge knows of a graph file."""

    devices: Mapping[str, Device]
    hoses: tuple[Hose, ...]
    dry: tuple[DryLink, ...] = ()
    faults: tuple[str, ...] = ()
    """What is wrong with the file as a whole; a compiler may then refuse every request."""
    by_end: dict[End, list[Hose]] = field(init=False)
    by_device: dict[str, list[End]] = field(init=False)
    dry_ends: dict[End, str] = field(init=False)

    def __post_init__(self) -> None:
        ends: dict[End, list[Hose]] = defaultdict(list)
        devices: dict[str, list[End]] = defaultdict(list)
        for hose in self.hoses:
            for end in (hose.a, hose.b):
                ends[end].append(hose)
                if end not in devices[end[0]]:
                    devices[end[0]].append(end)
        self.by_end, self.by_device = dict(ends), dict(devices)
        self.dry_ends = {end: link.medium for link in self.dry for end in (link.a, link.b)}

    def hoses_at(self, end: End) -> list[Hose]:
        """List the hoses on one port."""
        return self.by_end.get(end, [])

    def ends_of(self, device_id: str) -> list[End]:
        """List the ports of a device that have a hose."""
        return self.by_device.get(device_id, [])

    def outer_ports(self, device_id: str) -> list[str]:
        """List the ports with a hose between which a valve selects."""
        common = self.devices[device_id].common
        return [port for _, port in self.ends_of(device_id) if port not in {common, ""}]

    def has_port(self, device_id: str, port: str) -> bool:
        """Tell whether a valve can be told to go to this port."""
        device = self.devices[device_id]
        if port in {device.common, ""}:
            return False
        end = (device_id, port)
        return end in self.by_end or end in self.dry_ends or port in device.declared

    def vessels(self) -> list[str]:
        """List the vessels, in the order of the file."""
        return [one.id for one in self.devices.values() if one.kind is Kind.VESSEL]

    def pumps(self) -> list[str]:
        """List the syringes, with or without a valve, whose volume is known."""
        kinds = {Kind.PUMP, Kind.PUMP_VALVE}
        return [one.id for one in self.devices.values() if one.kind in kinds and one.capacity_nl]

    def neighbours(self, device_id: str) -> Iterator[str]:
        """Yield the devices linked to this one by any medium."""
        for end in self.ends_of(device_id):
            for hose in self.hoses_at(end):
                yield hose.other(end)[0]
        for link in self.dry:
            if device_id in {link.a[0], link.b[0]}:
                yield link.b[0] if link.a[0] == device_id else link.a[0]
