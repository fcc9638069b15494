"""What a pipette may do with a tip: mount it, draw into it, give out of it, put it away.

The tip is a Vessel that stands in a channel or in a spot of its rack, so half-moved liquid
always has a place, and a tip that is put away takes along what is still in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar
from uuid import UUID

from labweb.domain.crutd.operations import TransferLiquid, TransferResource
from labweb.domain.crutd.settlement import ResourceState, Snapshot, check
from labweb.domain.errors import Finding, PreconditionError
from labweb.domain.resources.contents_by_lot import total_nl
from labweb.domain.units import render_volume

TIP = "tip"


def find_tip(place_id: UUID, snapshot: Snapshot) -> ResourceState | None:
    """Return the tip that stands in a channel or a spot, if there is one."""
    tips = (state for state in snapshot.values() if state.kind == TIP)
    return next((tip for tip in tips if tip.parent_id == place_id), None)


def mount(spot_id: UUID, channel_id: UUID, snapshot: Snapshot) -> TransferResource:
    """Return the operation that takes the tip of a spot onto a channel.

    Raises:
        PreconditionError: The channel has a tip, the spot has none, or the move itself is
            refused; findings list each.
    """
    tip = find_tip(spot_id, snapshot)
    findings = _check_bare(channel_id, snapshot)
    if tip is None:
        findings.append(_no_tip(spot_id, snapshot))
        raise _refused(findings)
    operation = TransferResource(resource_id=tip.id, from_id=spot_id, to_id=channel_id)
    return _checked(operation, findings, snapshot)


def put_away(
    channel_id: UUID, place_id: UUID, snapshot: Snapshot, *, may_hold_liquid: bool = False
) -> TransferResource:
    """Return the operation that puts the tip of a channel into a spot or another place.

    Args:
        channel_id: The channel.
        place_id: Where the tip goes.
        snapshot: State of both, and of every tip that stands in one of them.
        may_hold_liquid: A person agrees that what is in the tip goes with it.

    Raises:
        PreconditionError: There is no tip, its spot is taken, or it holds liquid and nobody
            agreed to that; findings list each.
    """
    tip = find_tip(channel_id, snapshot)
    if tip is None:
        raise _refused([_no_tip(channel_id, snapshot)])
    findings = []
    if snapshot[place_id].kind == "tip_spot":
        findings += _check_bare(place_id, snapshot)
    held_nl = total_nl(tip.contents)
    if held_nl and not may_hold_liquid:
        findings.append(
            Finding(
                "crutd.tip_holds_liquid",
                f"{tip.name} holds {render_volume(held_nl)}: give it out first, or agree that "
                "it goes with the tip",
                tip.name,
                {"resource_id": str(tip.id), "held_nl": held_nl},
            )
        )
    operation = TransferResource(resource_id=tip.id, from_id=channel_id, to_id=place_id)
    return _checked(operation, findings, snapshot)


def draw(channel_id: UUID, source_id: UUID, amount_nl: int, snapshot: Snapshot) -> TransferLiquid:
    """Return the operation that draws liquid from a vessel into the tip of a channel.

    Raises:
        PreconditionError: There is no tip, the vessel is short or the tip too small.
    """
    tip = find_tip(channel_id, snapshot)
    if tip is None:
        raise _refused([_no_tip(channel_id, snapshot)])
    operation = TransferLiquid(source_id=source_id, target_id=tip.id, amount_nl=amount_nl)
    return _checked(operation, [], snapshot)


def give(channel_id: UUID, target_id: UUID, amount_nl: int, snapshot: Snapshot) -> TransferLiquid:
    """Return the operation that gives liquid out of the tip of a channel into a vessel.

    Raises:
        PreconditionError: There is no tip, it is short or the vessel has no room.
    """
    tip = find_tip(channel_id, snapshot)
    if tip is None:
        raise _refused([_no_tip(channel_id, snapshot)])
    operation = TransferLiquid(source_id=tip.id, target_id=target_id, amount_nl=amount_nl)
    return _checked(operation, [], snapshot)


def _check_bare(place_id: UUID, snapshot: Snapshot) -> list[Finding]:
    tip = find_tip(place_id, snapshot)
    if tip is None:
        return []
    name = snapshot[place_id].name
    return [Finding("crutd.has_tip", f"{name} has a tip already: {tip.name}", name)]


def _no_tip(place_id: UUID, snapshot: Snapshot) -> Finding:
    name = snapshot[place_id].name
    return Finding("crutd.no_tip", f"{name} has no tip", name)


_Op = TypeVar("_Op", TransferLiquid, TransferResource)


def _checked(operation: _Op, findings: Sequence[Finding], snapshot: Snapshot) -> _Op:
    found = [*findings, *check(operation, snapshot)]
    if found:
        raise _refused(found)
    return operation


def _refused(findings: Sequence[Finding]) -> PreconditionError:
    return PreconditionError(findings[0].message, code=findings[0].code, findings=findings)
