"""What the links of an imported graph carry, once the kinds of what they join are known."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.graph.lab_file.uni_lab_os.format_words import FORMAT
from labweb.domain.graph.ports_and_connections import Connection, Medium, PortRef
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import KINDS, VACUUMS

_CARRIED_BY: Mapping[str, Medium] = {
    "heater": Medium.THERMAL,
    "thermostat": Medium.THERMAL,
    "heater_stirrer": Medium.THERMAL,
    "stirrer": Medium.MECHANICAL,
}
"""How an instrument acts on what a tube-like link joins it to."""


def name_media(lab: LabFile, tubes: Collection[str]) -> tuple[Connection, ...]:
    """Return the connections of a lab with what each carries by the kinds of its two ends.

    A tube that ends at a source of gas or at a vacuum pump carries gas; one from a vacuum
    pump straight to a vessel is its vacuum.

    Args:
        lab: Imported, with its kinds.
        tubes: Types of link that are tubes, beside the one for fluids.
    """
    return tuple(
        replace(connection, medium=_medium(lab, connection, tubes))
        for connection in lab.connections
    )


def _medium(lab: LabFile, connection: Connection, tubes: Collection[str]) -> Medium:
    link = connection.extra.get(FORMAT)
    if not isinstance(link, Mapping) or connection.medium not in (Medium.LIQUID, Medium.OTHER):
        return connection.medium
    is_drawn = connection.medium is Medium.LIQUID
    if not is_drawn and link["link"].get("type") not in tubes:
        return connection.medium
    ends = [lab.tree.by_id[end.resource_id] for end in (connection.source, connection.target)]
    if not is_drawn:
        acting = next((_CARRIED_BY[end.kind] for end in ends if end.kind in _CARRIED_BY), None)
        if acting is not None:
            return acting
    if any(end.kind in VACUUMS for end in ends):
        return Medium.VACUUM if any(KINDS[end.kind].holds_liquid for end in ends) else Medium.GAS
    if any(end.config.get("gas") for end in ends):
        return Medium.GAS
    passes = all(KINDS[end.kind].holds_liquid or KINDS[end.kind].conducts for end in ends)
    return Medium.LIQUID if is_drawn or passes else connection.medium


def tubes_of(lab: LabFile, resource: Resource) -> Iterator[tuple[PortRef, PortRef]]:
    """Yield both ends of each tube for liquid at a resource, its own first."""
    for connection in lab.graph.by_resource.get(resource.id, ()):
        if connection.medium is Medium.LIQUID:
            ends = (connection.source, connection.target)
            yield ends if ends[0].resource_id == resource.id else ends[::-1]


def largest_port(lab: LabFile, resource: Resource) -> int | None:
    """Return the largest number of a port of a resource at which a tube is, None without one."""
    ports = (own.port for own, _ in tubes_of(lab, resource))
    return max((int(port) for port in ports if port.isascii() and port.isdecimal()), default=None)
