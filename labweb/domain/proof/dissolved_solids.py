"""Solids of which a person has stated what goes along with a liquid, and what stays."""

from __future__ import annotations

from collections.abc import Mapping

from labweb.domain.graph.elements import ElementRole
from labweb.domain.messages.step_claims import Claim
from labweb.domain.proof.gas_and_vacuum import Before, fail
from labweb.domain.proof.lot_amount_ranges import NOTHING, UNITS_PER_NL, AmountRange, Contents
from labweb.domain.proof.plan_read import mass_units
from labweb.domain.proof.plan_state import TOLERANCE, State

BELOW_THE_FRIT = "bottom"
"""Port of a filter that no solid leaves by."""


def take_stated(state: State, key: str, taken: Contents, stated: Mapping[str, float]) -> None:
    """Let go along so much of each solid, in µg, and of no other; note what is not there.

    Effect:
        The vessel loses it, `taken` gains it.
    """
    held = state.held(key)
    for lot, mass_ug in sorted(stated.items()):
        wanted, there = mass_units(mass_ug), held.solids.get(lot, NOTHING)
        if wanted > there.least + TOLERANCE:
            message = (
                f"{mass_ug:g} µg of solid {lot} leave {key}, which holds for certain "
                f"{there.least / UNITS_PER_NL:g} µg of it"
            )
            state.complain("interpret.not_there", message, vessel=key)
        part = min(wanted, there.least)
        held.solids[lot] = AmountRange(there.least - part, there.most - part)
        taken.solids[lot] = taken.solids.get(lot, NOTHING) + AmountRange.exactly(part)
    held.solids = {lot: amount for lot, amount in held.solids.items() if amount.most}


def stop_solids(
    state: State, taken: Contents, passed: tuple[str, ...], *, is_dissolved: bool
) -> None:
    """Leave solids in the first cartridge on the way, but for what is stated as dissolved."""
    if is_dissolved:
        return
    cartridge = next(
        (key for key in passed if state.plumbing.elements[key].role is ElementRole.CARTRIDGE), None
    )
    if cartridge is not None and taken.solids:
        state.held(cartridge).add(Contents({}, taken.solids))
        taken.solids = {}


def check_solids(state: State, claim: Claim) -> None:
    """Compare what went over of each solid with what a person has stated.

    Of what was stated as all there is, nothing is left.
    """
    held = state.held(claim.from_ or "")
    for lot in claim.whole or ():
        left = held.solids.get(lot, NOTHING) + held.liquids.get(lot, NOTHING)
        if left.most > TOLERANCE:
            fail(state, f"all of {lot} is to go over, and some stays in {claim.from_}")
    if claim.solids is None:
        return
    flows = state.record.flows
    for lot in sorted({*claim.solids, *(lot for flow in flows for lot in flow.solids)}):
        asked = mass_units(claim.solids.get(lot, 0.0))
        moved = sum((flow.solids.get(lot, NOTHING) for flow in flows), NOTHING)
        _compare(state, f"of solid {lot}", moved, asked, "go over")


def check_stays(state: State, claim: Claim, before: Before) -> None:
    """Compare what is left of each solid with what a person has stated; unset: all of it.

    Only what is drawn below the frit leaves solids behind.
    """
    vessel = claim.vessel or ""
    for port in sorted({flow.source.port for flow in state.record.flows} - {BELOW_THE_FRIT}):
        fail(state, f"solids leave {vessel} by its port {port}, which is not below its frit")
    left, stays = state.held(vessel).solids, claim.stays or {}
    was = before.contents.get(vessel, Contents()).solids
    for lot, held in sorted(was.items()):
        there = left.get(lot, NOTHING)
        if lot in stays:
            _compare(state, f"of solid {lot}", there, mass_units(stays[lot]), "stay")
        elif there != held:
            fail(state, f"solids leave {vessel}")


def _compare(state: State, what: str, found: AmountRange, asked: int, verb: str) -> None:
    if abs(found.least - asked) > TOLERANCE or abs(found.most - asked) > TOLERANCE:
        grams = f"{found.most / UNITS_PER_NL:g} µg {verb}, not {asked / UNITS_PER_NL:g} µg"
        fail(state, f"{what} {grams}")
