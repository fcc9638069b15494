"""What connects a thing with the rest of the lab, and which of that keeps it where it is."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from uuid import UUID

from labweb.domain.errors import Finding
from labweb.domain.graph.ports_and_connections import Connection, Medium, PortRef

LOOSE = frozenset({Medium.MECHANICAL, Medium.TRANSPORT})
"""Media of what only stands there, or is put there: lifting it off breaks nothing.

Any other is a tube, a jacket, a wire, or something that nobody has named. A tube that is
pulled off spills, so nobody may guess that it is loose.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Attachment:
    """One connection that leads out of what is to be carried."""

    key: str
    """Of the connection, in the lab file."""

    medium: Medium
    own: PortRef
    """End that would be carried."""

    other: PortRef
    """End that would stay."""


def find_attachments(
    connections: Iterable[Connection], carried: Collection[UUID]
) -> tuple[Attachment, ...]:
    """Return what leads out of a thing, of any medium; what lies wholly inside comes along.

    Args:
        connections: Those of the lab, or those that touch what is carried.
        carried: The thing, and all that stands in it.
    """
    inside = frozenset(carried)
    found = []
    for one in connections:
        ends = (one.source, one.target)
        own = [end for end in ends if end.resource_id in inside]
        if len(own) == 1:
            other = ends[1] if own[0] is ends[0] else ends[0]
            found.append(Attachment(key=one.key, medium=one.medium, own=own[0], other=other))
    return tuple(sorted(found, key=lambda one: (one.key, one.own)))


def that_hold(attachments: Iterable[Attachment]) -> tuple[Attachment, ...]:
    """Return those that keep a thing where it is: lifting it off would break them."""
    return tuple(one for one in attachments if one.medium not in LOOSE)


def check_loose(name: str, subject: str, attachments: Collection[Attachment]) -> list[Finding]:
    """Refuse to carry what is connected, and name each connection.

    Args:
        name: What a person calls the thing.
        subject: Its id as text.
        attachments: As `find_attachments` gives them.
    """
    holding = that_hold(attachments)
    if not holding:
        return []
    listed = ", ".join(f"{one.key} ({one.medium.value})" for one in holding)
    text = f"{name} is connected and cannot be carried: {listed}"
    context = {"resource_id": subject, "connections": [to_json(one) for one in holding]}
    return [Finding("crutd.connected", text, name, context)]


def to_json(one: Attachment) -> dict[str, str]:
    """Render as plain data."""
    return {
        "key": one.key,
        "medium": one.medium.value,
        "resource_id": str(one.own.resource_id),
        "port": one.own.port,
        "other_id": str(one.other.resource_id),
        "other_port": one.other.port,
    }
