"""The ways of liquid between vessels of the rig, and what each goes over."""

from __future__ import annotations

from dataclasses import dataclass

from labweb.domain.errors import Finding
from labweb.domain.graph.syringe_chain import SyringeChain, WantedChain, find_chain
from labweb.domain.recipes.on_rig.equipment import COLLECT, VesselSort
from labweb.domain.recipes.on_rig.making import Making, used_parts
from labweb.domain.recipes.transfers_on_rig import TransferRequest, plan_on_rig
from labweb.domain.recipes.xdl.file_format.xml_tree import FilePlace
from labweb.domain.workflows.passes.liquids.stroke_pipeline import Group

_ANY_NL = 1_000
"""Which way it is does not hang on how much goes over."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RigMove:
    """A transfer that is asked for, between vessels of the rig."""

    source: str
    target: str
    place: FilePlace
    through: tuple[str, ...] = ()
    source_port: str | None = None
    target_port: str | None = None
    draw_rate_ul_s: float | None = None
    push_rate_ul_s: float | None = None
    kind: str = "transfer"
    over: str | None = None
    """A syringe that it has to go over."""

    onto: str = ""
    """The vessel that the next move over the same lines goes into; "": nobody knows."""


def route(making: Making, move: RigMove, amount_nl: int) -> list[Group] | None:
    """Plan the strokes of a move; None: there is no way, which is told."""
    groups, findings = _strokes(making, move, amount_nl)
    for finding in findings:
        message = f"{move.source} to {move.target}: {finding.message}"
        owner = move.source.partition("#")[0]
        facts = {"from": owner, "to": move.target, "through": list(move.through)}
        making.told.tell(finding.code, message, move.place, at=finding.subject, **facts)
    return None if findings else groups


def parts_of(making: Making, move: RigMove) -> frozenset[str]:
    """Return the syringes and valves that a move goes over; none: there is no way."""
    groups, _ = _strokes(making, move, _ANY_NL)
    return used_parts(groups)


def _strokes(making: Making, move: RigMove, amount_nl: int) -> tuple[list[Group], list[Finding]]:
    owner, port = _leaves(making, move.source)
    request = TransferRequest(
        source=owner,
        target=move.target.partition("#")[0],
        amount_nl=amount_nl,
        source_port=port if owner != move.source else move.source_port or port,
        target_port=COLLECT if "#" in move.target else move.target_port,
        draw_rate_ul_s=move.draw_rate_ul_s,
        push_rate_ul_s=move.push_rate_ul_s,
        through=move.through,
        over=move.over,
    )
    return plan_on_rig(making.equipment.rig, request)


def _leaves(making: Making, source: str) -> tuple[str, str | None]:
    """Return the element that is drawn from and by which port, where another leads elsewhere."""
    owner, _, part = source.partition("#")
    is_rotavap = making.equipment.sort(owner) is VesselSort.ROTAVAP
    port = making.equipment.elements[owner].leave_by if is_rotavap else None
    return owner, COLLECT if part else port


def chain_of(
    making: Making, source: str, target: str, over: int | None = None
) -> SyringeChain | None:
    """Return the way from one vessel to another, where asked for over a syringe, or None."""
    network = making.equipment.rig.network
    owner, port = _leaves(making, source)
    into, _, part = target.partition("#")
    if owner == into:
        return None
    wanted = WantedChain(
        source=network.index[owner],
        target=network.index[into],
        source_port=port,
        target_port=COLLECT if part else None,
        over=over,
    )
    return find_chain(network, wanted)
