"""Compare what a step claims with what it did."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from labweb.domain.messages import plan_fields as words
from labweb.domain.messages.step_claims import Claim
from labweb.domain.proof.device_abilities import devices_at
from labweb.domain.proof.dissolved_solids import check_solids, check_stays
from labweb.domain.proof.gas_and_vacuum import (
    PUMP_WORDS,
    Before,
    check_conditions,
    check_gas,
    check_settings,
    check_stop_gas,
    check_vacuum,
    check_vent,
    fail,
)
from labweb.domain.proof.incompatible_liquids import is_waste
from labweb.domain.proof.lot_amount_ranges import NOTHING, Contents
from labweb.domain.proof.plan_read import mass_units, units
from labweb.domain.proof.plan_state import (
    LOWER,
    TOLERANCE,
    UPPER,
    Flow,
    ProofEffect,
    State,
    microlitres,
)

ALLOWED: Mapping[str, frozenset[str]] = {
    "fill": frozenset(("fill",)),
    "add_solid": frozenset(("add_solid",)),
    "empty": frozenset(("empty",)),
    "transfer": frozenset(("flow",)),
    "separate": frozenset(("flow", "watch", "watch_boundary", "stop_watching")),
    "filter": frozenset(("flow",)),
    "stir": frozenset(("stir",)),
    "stop_stir": frozenset(("stop_stirring",)),
    "heat": frozenset(("set_temperature",)),
    "reach": frozenset(("await_temperature",)),
    "stop_heat": frozenset(("stop_temperature",)),
    "wait": frozenset(("wait",)),
    "vacuum": frozenset(("start_vacuum", "set_supply")),
    "vent": frozenset(("stop_vacuum", "vent", "set_supply")),
    "gas": frozenset(("set_supply",)),
    "stop_gas": frozenset(("set_supply",)),
    "rotate": frozenset(("start_rotation",)),
    "stop_rotate": frozenset(("stop_rotation",)),
    "lower": frozenset(("lower_flask",)),
    "raise": frozenset(("raise_flask",)),
    "evaporate": frozenset(("evaporate",)),
    "light": frozenset(("start_light",)),
    "stop_light": frozenset(("stop_light",)),
    "measure": frozenset(("measure",)),
    "sonicate": frozenset(("start_ultrasound",)),
    "stop_sonicate": frozenset(("stop_ultrasound",)),
    "microwave": frozenset(("heat_by_microwave",)),
    "spin": frozenset(("spin",)),
    "distill": frozenset(("distill",)),
    "clean": frozenset(("flow",)),
    "prime": frozenset(("flow",)),
    "flush": frozenset(("gas",)),
    "push": frozenset(("gas",)),
    "become": frozenset(("become",)),
    "ask": frozenset(),
}
"""Kind of a claim → what its step may do. A `check` by hand may stand anywhere."""

_NOWHERE = PUMP_WORDS | {"set_supply", "wait", "distill"}
"""Actions that are not done to a vessel that a link joins to their device."""


def check_claim(state: State, claim: Claim, before: Before) -> None:
    """Add a finding for everything that a step claims and did not do, or did and does not claim."""
    _check_unclaimed(state, claim)
    _CHECKS[claim.kind](state, claim, before)
    check_conditions(state, claim, before)


def _check_unclaimed(state: State, claim: Claim) -> None:
    allowed = ALLOWED[claim.kind]
    for flow in state.record.flows:
        if ("gas" if flow.is_gas else "flow") not in allowed:
            message = f"{flow.source.key} flows into {flow.target.key} in a {claim.kind}"
            state.complain("interpret.unclaimed", message)
    at = (claim.vessel or claim.to,)
    for effect in state.record.effects:
        is_here = effect.name in _NOWHERE or effect.vessels == at
        if effect.name == "check" or (effect.name in allowed and is_here):
            continue
        message = f"{effect.name} of {effect.device} {list(effect.vessels)} in a {claim.kind}"
        state.complain("interpret.unclaimed", message)


def _effects(state: State, name: str) -> list[ProofEffect]:
    return [effect for effect in state.record.effects if effect.name == name]


def _check_by_hand(state: State, claim: Claim, before: Before) -> None:
    del before
    if claim.kind == "empty":
        if not _effects(state, "empty") or not state.held(str(claim.vessel)).holds_nothing:
            fail(state, f"{claim.vessel} is not emptied")
        return
    wanted = units(claim.volume_ul or 0) if claim.kind == "fill" else mass_units(claim.mass_ug or 0)
    found = _effects(state, claim.kind)
    lots = {effect.lot for effect in found}
    amount = sum(value for effect in found if isinstance(value := effect.value, int))
    if amount != wanted or lots != {claim.lot}:
        fail(state, f"{claim.to} got {amount} of {sorted(lots)}, not {wanted} of {claim.lot}")


def _check_transfer(state: State, claim: Claim, before: Before) -> None:
    flows = state.record.flows
    _check_ends(state, flows, claim.from_, {claim.to}, claim.through or [])
    source = before.contents.get(claim.from_ or "", Contents())
    if claim.all:
        _check_all(state, claim.from_, claim.most_ul, flows)
    else:
        _check_volume(state, flows, claim.volume_ul)
    if claim.lots is not None:
        _check_lots(state, flows, claim.lots)
    check_solids(state, claim)
    if claim.lot is None:
        return
    went = {lot for flow in flows for part in (flow.liquids, flow.solids) for lot in part}
    held = {lot for part in (source.liquids, source.solids) for lot, a in part.items() if a.most}
    if went != {claim.lot} or held != {claim.lot}:
        fail(state, f"{sorted(went)} went over, out of {sorted(held)}, not {claim.lot} alone")


def _check_lots(state: State, flows: list[Flow], wanted: Mapping[str, float]) -> None:
    """Compare how much of each lot went over with what a person has stated."""
    for lot in sorted({*wanted, *(lot for flow in flows for lot in flow.liquids)}):
        asked = units(wanted.get(lot, 0.0))
        moved = sum((flow.liquids.get(lot, NOTHING) for flow in flows), NOTHING)
        if abs(moved.least - asked) > TOLERANCE or abs(moved.most - asked) > TOLERANCE:
            fail(state, f"of {lot} {microlitres(moved.most)} go over, not {microlitres(asked)}")


def _check_volume(state: State, flows: list[Flow], volume_ul: float | None) -> None:
    wanted = units(volume_ul or 0)
    moved = sum((flow.volume for flow in flows), NOTHING)
    if abs(moved.least - wanted) > TOLERANCE or abs(moved.most - wanted) > TOLERANCE:
        fail(
            state,
            f"between {microlitres(moved.least)} and {microlitres(moved.most)} went over, "
            f"not {microlitres(wanted)}",
        )


def _check_all(state: State, source: str | None, most_ul: float | None, flows: list[Flow]) -> None:
    left = state.held(source or "").volume.most
    if left > TOLERANCE:
        fail(state, f"up to {microlitres(left)} may be left in {source}")
    moved = sum((flow.volume for flow in flows), NOTHING)
    if moved.most > units(most_ul or 0) + TOLERANCE:
        fail(state, f"up to {microlitres(moved.most)} may go over, more than is claimed")


def _check_ends(
    state: State,
    flows: list[Flow],
    source: str | None,
    targets: set[str | None],
    through: list[str],
) -> None:
    for flow in flows:
        if flow.source.key != source or flow.target.key not in targets:
            fail(state, f"liquid goes from {flow.source.key} to {flow.target.key}")
        if (passed := _passed(state, flow, through)) != through:
            message = f"it goes through {passed}, not {through}"
            state.complain("interpret.through", message)


def _passed(state: State, flow: Flow, named: list[str]) -> list[str]:
    """Return what liquid went through, without manifolds that nobody speaks of."""
    elements = state.plumbing.elements
    return [key for key in flow.passed if key in named or elements[key].role != "manifold"]


def _check_filter(state: State, claim: Claim, before: Before) -> None:
    vessel = claim.vessel or ""
    _check_ends(state, state.record.flows, vessel, {claim.to}, [])
    _check_all(state, vessel, claim.most_ul, state.record.flows)
    check_stays(state, claim, before)


def _check_separate(state: State, claim: Claim, before: Before) -> None:
    vessel = claim.vessel or ""
    if vessel not in state.record.parting:
        fail(state, f"nothing looks for the boundary in {vessel}")
        return
    for phase, target in ((LOWER, claim.lower_to), (UPPER, claim.upper_to)):
        places = {key for key, phases in state.phases.items() if phase in phases}
        if stray := places - {target}:
            fail(state, f"the {phase} phase may be in {sorted(stray)}, not only in {target}")
    if vessel not in (claim.lower_to, claim.upper_to) and not state.held(vessel).holds_nothing:
        fail(state, f"{vessel} may still hold something")
    known = before.contents.get(vessel, Contents())
    if known.volume.most > units(claim.most_ul or 0) + TOLERANCE:
        fail(state, f"{vessel} may hold {microlitres(known.volume.most)}, more than is claimed")
    _check_phase_ways(state, claim, before)


def _check_phase_ways(state: State, claim: Claim, before: Before) -> None:
    flows = state.record.flows
    ways = {
        claim.lower_to: claim.lower_through or [],
        claim.upper_to: claim.upper_through or [],
    }
    sources, targets = ({f.source.key for f in flows}, {f.target.key for f in flows})
    resting = sources & targets
    for flow in flows:
        if flow.target.key not in {*ways, *resting} or flow.source.key not in {
            claim.vessel,
            *resting,
        }:
            fail(state, f"liquid goes from {flow.source.key} to {flow.target.key}")
        named = ways.get(flow.target.key, [])
        if (passed := _passed(state, flow, named)) != named:
            message = f"{passed} is passed on the way to {flow.target.key}"
            state.complain("interpret.through", message)
    for key in resting - {claim.vessel}:
        if not before.contents.get(key, Contents()).holds_nothing:
            fail(state, f"{key}, where a phase rests, held something")
        if key not in ways and not state.held(key).holds_nothing:
            fail(state, f"{key} may keep some of what rested in it")


def _check_flush(state: State, claim: Claim, before: Before) -> None:
    del before
    target = state.plumbing.elements.get(claim.to or "")
    if claim.kind == "flush" and not (target and is_waste(target)):
        fail(state, f"{claim.to} is no waste, which gas is flushed into")
    wanted, pushed = units(claim.volume_ul or 0), 0
    for flow in state.record.flows:
        pushed += flow.nominal
        if (flow.source.key, flow.target.key) != (claim.from_, claim.to):
            fail(state, f"gas goes from {flow.source.key} to {flow.target.key}")
        if any(state.plumbing.elements[key].role != "manifold" for key in flow.passed):
            state.complain("interpret.through", f"gas goes through {list(flow.passed)}")
    if pushed != wanted:
        fail(state, f"{microlitres(pushed)} of gas is pushed, not {microlitres(wanted)}")


def _check_setting(state: State, claim: Claim, before: Before) -> None:
    """Compare what runs at a vessel with what is claimed of it; None: nothing may run."""
    del before
    action, table, wanted = {
        "stir": ("stir", state.stirring, claim.speed_rpm),
        "stop_stir": ("stir", state.stirring, None),
        "heat": ("set_temperature", state.temperatures, claim.temperature_c),
        "stop_heat": ("set_temperature", state.temperatures, None),
        "rotate": ("start_rotation", state.rotating, claim.speed_rpm),
        "stop_rotate": ("start_rotation", state.rotating, None),
    }[claim.kind]
    devices = devices_at(state.plumbing, claim.vessel or "", action)
    found = {table[device] for device in devices if device in table}
    if found != (set() if wanted is None else {wanted}):
        fail(state, f"{claim.vessel} has {sorted(found)} and not {wanted} ({claim.kind})")
    check_settings(state, action, wanted)


def _check_reach(state: State, claim: Claim, before: Before) -> None:
    del before
    windows = [effect.value for effect in _effects(state, "await_temperature")]
    if {*windows} != {(claim.low_c, claim.high_c)}:
        fail(state, f"nothing waits until {claim.vessel} is in the window")


def _check_wait(state: State, claim: Claim, before: Before) -> None:
    del before
    total = sum(v for e in _effects(state, "wait") if isinstance(v := e.value, float | int))
    if abs(total - (claim.duration_s or 0)) > 1e-6:
        fail(state, f"{total:g} s pass, not {claim.duration_s:g}")


def _check_flask(state: State, claim: Claim, before: Before) -> None:
    del before
    if (claim.vessel in state.lowered) is not (claim.kind == "lower"):
        fail(state, f"{claim.vessel}: its flask is not where {claim.kind!r} says")


def _check_evaporate(state: State, claim: Claim, before: Before) -> None:
    del before
    found = [effect.value for effect in _effects(state, "evaporate")]
    if found != [(claim.duration_s, claim.most_s)]:
        fail(state, f"{claim.vessel} does not boil down once as claimed")


def _check_light(state: State, claim: Claim, before: Before) -> None:
    del before
    lamps = devices_at(state.plumbing, claim.vessel or "", "start_light")
    lit = [state.lights[lamp] for lamp in lamps if lamp in state.lights]
    if bool(lit) is not (claim.kind == "light"):
        fail(state, f"the light at {claim.vessel} is not as claimed")
    said = [*lit, *(effect.value for effect in _effects(state, "start_light"))]
    if any(one != said[0] for one in said):
        fail(state, f"{claim.vessel} is lit in more than one way")
    for name in words.Light.__struct_fields__:
        wanted = getattr(claim, name)
        if wanted is not None and any(getattr(one, name) != wanted for one in said):
            fail(state, f"{claim.vessel} is not lit with {name} {wanted}")


def _check_measure(state: State, claim: Claim, before: Before) -> None:
    del before
    wanted = (claim.quantity, claim.low, claim.high)
    if [effect.value for effect in _effects(state, "measure")] != [wanted]:
        fail(state, f"{claim.quantity} of {claim.vessel} is not measured once as claimed")


def _check_sound(state: State, claim: Claim, before: Before) -> None:
    del before
    baths = devices_at(state.plumbing, claim.vessel or "", "start_ultrasound")
    if bool(state.sounding.intersection(baths)) is not (claim.kind == "sonicate"):
        fail(state, f"ultrasound at {claim.vessel} is not as claimed")


def _check_once(state: State, claim: Claim, before: Before) -> None:
    """Compare what a device does of itself, from beginning to end, with what is claimed of it."""
    del before
    action, wanted = {
        "microwave": (
            "heat_by_microwave",
            (claim.temperature_c, claim.duration_s, claim.power_w),
        ),
        "spin": (
            "spin",
            (claim.speed_rpm, claim.acceleration_g, claim.duration_s, claim.temperature_c),
        ),
        "distill": ("distill", (claim.vessel, claim.to, claim.duration_s, claim.vapour_c)),
    }[claim.kind]
    if [effect.value for effect in _effects(state, action)] != [wanted]:
        fail(state, f"{action} is not done once as claimed")
    heaters = devices_at(state.plumbing, claim.vessel or "", "set_temperature")
    if claim.kind == "distill" and not state.temperatures.keys() & set(heaters):
        fail(state, f"nothing heats {claim.vessel} while it is distilled")


def _check_become(state: State, claim: Claim, before: Before) -> None:
    del before
    liquids, solids = (claim.takes or {}, claim.gives or {}), (claim.takes_ug, claim.gives_ug)
    wanted = (*liquids, *(one or {} for one in solids), claim.to)
    if [effect.value for effect in _effects(state, "become")] != [wanted]:
        fail(state, f"the lots in {claim.vessel} do not become what is claimed")


def _check_ask(state: State, claim: Claim, before: Before) -> None:
    del before
    if claim.text not in [effect.value for effect in _effects(state, "check")]:
        fail(state, "nobody is asked this")


_CHECKS: Mapping[str, Callable[[State, Claim, Before], None]] = {
    "fill": _check_by_hand,
    "add_solid": _check_by_hand,
    "empty": _check_by_hand,
    "transfer": _check_transfer,
    "clean": _check_transfer,
    "separate": _check_separate,
    "filter": _check_filter,
    "prime": _check_transfer,
    **dict.fromkeys(("flush", "push"), _check_flush),
    **dict.fromkeys(
        ("stir", "stop_stir", "heat", "stop_heat", "rotate", "stop_rotate"), _check_setting
    ),
    "reach": _check_reach,
    "wait": _check_wait,
    "vacuum": check_vacuum,
    "vent": check_vent,
    "gas": check_gas,
    "stop_gas": check_stop_gas,
    "lower": _check_flask,
    "raise": _check_flask,
    "evaporate": _check_evaporate,
    "light": _check_light,
    "stop_light": _check_light,
    "measure": _check_measure,
    "sonicate": _check_sound,
    "stop_sonicate": _check_sound,
    "microwave": _check_once,
    "spin": _check_once,
    "distill": _check_once,
    "become": _check_become,
    "ask": _check_ask,
}
