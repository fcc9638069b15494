"""Compare gas and vacuum on vessels with what a step claims of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from labweb.domain.messages.step_claims import Claim
from labweb.domain.proof.device_abilities import pumps_of
from labweb.domain.proof.lot_amount_ranges import Contents
from labweb.domain.proof.plan_state import State

PUMP_WORDS = frozenset(("start_vacuum", "stop_vacuum", "vent"))
FOR_GAS = frozenset(("vacuum", "vent", "gas", "stop_gas"))
"""Kinds of claims that speak of gas and vacuum."""


@dataclass(frozen=True, slots=True)
class Before:
    """What was true when a step began."""

    contents: Mapping[str, Contents]
    sources: Mapping[str, set[str]]
    vacuum: Mapping[str, set[str]]
    may_draw: Mapping[str, set[str]]
    """As `vacuum`, where a valve that nobody has turned yet may stand anywhere."""

    lines: Mapping[str, set[str]]


def fail(state: State, message: str) -> None:
    """Add a finding that a step does not do what it claims."""
    state.complain("interpret.claim", message)


def check_vacuum(state: State, claim: Claim, before: Before) -> None:
    """Refuse a vessel that no running vacuum is on, and pumps at another pressure."""
    vessel = claim.vessel or ""
    running = state.running_vacuum(vessel)
    if not running:
        fail(state, f"no running vacuum is on {vessel}")
    lines = {line for line in running if state.plumbing.elements[line].role == "vacuum"}
    pumps = {pump for line in lines for pump in pumps_of(state.plumbing, line)}
    for pump in pumps & state.running_pumps():
        if state.vacuums[pump].pressure_mbar != claim.pressure_mbar:
            fail(state, f"{pump} draws to {state.vacuums[pump].pressure_mbar} mbar")
    check_settings(state, "start_vacuum", claim.pressure_mbar)
    _check_pumps(state, pumps)
    _check_also(state, claim, before)


def check_settings(state: State, action: str, wanted: object) -> None:
    """Refuse what a step sets on the way to what it claims: matter sees that, too."""
    for effect in state.record.effects:
        if effect.name == action and effect.value != wanted:
            fail(state, f"{effect.device} is set to {effect.value} on the way, not to {wanted}")


def _check_also(state: State, claim: Claim, before: Before) -> None:
    """Compare the vessels that share the vacuum with those that the claim names beside its own."""
    for vessel in claim.also or ():
        was_on, is_on = before.vacuum.get(vessel, set()), state.running_vacuum(vessel)
        does = is_on - was_on if claim.kind == "vacuum" else was_on - is_on
        if vessel == claim.vessel or not does or (is_on and claim.kind == "vent"):
            fail(state, f"the vacuum on {vessel} does not come or go with that on {claim.vessel}")
        if not before.contents.get(vessel, Contents()).holds_nothing:
            message = f"vacuum on {claim.vessel} is on {vessel} too, which may hold something"
            state.complain("interpret.vacuum_shared", message, vessel=vessel)


def _check_pumps(state: State, pumps: set[str]) -> None:
    """Refuse what is done to vacuum pumps that the vessel is not joined to."""
    for effect in state.record.effects:
        if effect.name in PUMP_WORDS and effect.device not in pumps:
            message = f"{effect.name} of {effect.device}, which is not joined to the vessel"
            state.complain("interpret.unclaimed", message)


def check_vent(state: State, claim: Claim, before: Before) -> None:
    """Refuse a vessel that vacuum is still on, and pumps that are not stopped and vented."""
    vessel = claim.vessel or ""
    if state.running_vacuum(vessel, maybe=True):
        fail(state, f"running vacuum is, or may be, on {vessel}")
    joined = state.lines(vessel)
    _check_off(state, vessel)
    if claim.gas is None and state.sources(vessel) - before.sources.get(vessel, set()):
        fail(state, f"{vessel} is joined to {sorted(state.sources(vessel))}")
    lines = before.lines.get(vessel, set()) | joined
    pumps = {pump for line in lines for pump in pumps_of(state.plumbing, line)}
    for pump in sorted(pumps):
        vacuum = state.vacuums.get(pump)
        if vacuum is None or vacuum.is_running or not vacuum.is_vented:
            fail(state, f"{pump} is not stopped and vented")
    _check_pumps(state, pumps)
    _check_also(state, claim, before)
    if claim.gas is not None:
        check_gas(state, claim, before)


def _check_off(state: State, vessel: str) -> None:
    """Refuse a vacuum line, running or not, that a valve could take off the vessel."""
    if lines := state.lines(vessel) - state.lines_without_valves(vessel):
        fail(state, f"{vessel} is joined to {sorted(lines)}")


def check_gas(state: State, claim: Claim, before: Before) -> None:
    """Refuse a vessel that is not joined to the gas."""
    del before
    if claim.gas not in state.sources(claim.vessel or ""):
        fail(state, f"{claim.vessel} is not joined to {claim.gas}")


def check_stop_gas(state: State, claim: Claim, before: Before) -> None:
    """Refuse a vessel that is still joined to the gas."""
    sources = state.sources(claim.vessel or "")
    ended = {claim.gas} if claim.gas else before.sources.get(claim.vessel or "", set())
    if sources & ended:
        fail(state, f"{claim.vessel} is still joined to {sorted(sources)}")
    _check_off(state, claim.vessel or "")


def check_conditions(state: State, claim: Claim, before: Before) -> None:
    """Refuse gas and vacuum that come or go where the claim does not say so."""
    for vessel in state.exposed:
        if claim.kind in FOR_GAS and vessel == claim.vessel:
            continue
        if state.sources(vessel) != before.sources.get(vessel, set()):
            message = f"gas on {vessel} comes or goes in a {claim.kind}"
            state.complain("interpret.gas_changed", message, vessel=vessel)
        if vessel in (claim.also or ()):
            continue
        comes = state.running_vacuum(vessel, maybe=True) - before.may_draw.get(vessel, set())
        if comes or state.running_vacuum(vessel) != before.vacuum.get(vessel, set()):
            message = f"vacuum on {vessel} comes or goes in a {claim.kind}"
            state.complain("interpret.vacuum_changed", message, vessel=vessel)
