"""Execute what other devices, the timer and people do."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from labweb.domain.messages import plan_fields as words
from labweb.domain.proof.device_abilities import devices_at, vessels_of
from labweb.domain.proof.dissolved_solids import take_stated
from labweb.domain.proof.lot_amount_ranges import AmountRange, Contents
from labweb.domain.proof.plan_read import Action, mass_units, units
from labweb.domain.proof.plan_state import (
    REMOVED,
    ROOM_C,
    TOLERANCE,
    ProofEffect,
    State,
    VacuumState,
    microlitres,
)
from labweb.domain.proof.plumbing import End


def act(state: State, action: Action) -> None:
    """Execute an action that moves no plunger and turns no valve."""
    if action.device == words.BY_HAND:
        _by_hand(state, action)
        return
    if action.device == words.DECLARED:
        _become(state, action)
        return
    vessels: tuple[str, ...] = ()
    if action.device != words.TIMER:
        vessels = tuple(vessels_of(state.plumbing, action.device))
        state.record.touched.update((action.device, *vessels))
    value = _DEEDS[action.name](state, action)
    state.record.effects.append(ProofEffect(action.name, action.device, vessels, value))


def _wait(state: State, action: Action) -> object:
    del state
    parameters = action.parameters
    return parameters.duration_s if isinstance(parameters, words.PlanWait) else None


def _stir(state: State, action: Action) -> object:
    parameters = action.parameters
    if isinstance(parameters, words.Stirring):
        table = state.stirring if action.name == "stir" else state.rotating
        table[action.device] = parameters.speed_rpm
        return parameters.speed_rpm
    return None


def _stop_stirring(state: State, action: Action) -> object:
    table = state.stirring if action.name == "stop_stirring" else state.rotating
    return table.pop(action.device, None)


def _set_temperature(state: State, action: Action) -> object:
    parameters = action.parameters
    if not isinstance(parameters, words.Temperature):
        return None
    wanted = state.temperatures[action.device] = parameters.temperature_c
    for vessel in vessels_of(state.plumbing, action.device):
        low, high = state.warmth.get(vessel, ROOM_C)
        state.warmth[vessel] = (min(low, wanted), max(high, wanted))
    return wanted


def _await_temperature(state: State, action: Action) -> object:
    parameters = action.parameters
    if not isinstance(parameters, words.Window):
        return None
    window = (parameters.low_c, parameters.high_c)
    for vessel in vessels_of(state.plumbing, action.device):
        why = _never_reaches(state, vessel, *window)
        if why:
            message = f"{why} and never gets between {window[0]:g} and {window[1]:g} °C"
            state.complain("interpret.never_reached", message, device=action.device)
    return window


def _never_reaches(state: State, vessel: str, low_c: float, high_c: float) -> str:
    """Tell why a vessel does not come into a window, "" when it does, and note that it is there."""
    near = devices_at(state.plumbing, vessel, "set_temperature")
    set_to = {state.temperatures[key] for key in near if key in state.temperatures}
    was = state.warmth.get(vessel, ROOM_C)
    coldest, warmest = min(was[0], ROOM_C[0]), max(was[1], ROOM_C[1])
    if low_c > high_c or not all(low_c <= one <= high_c for one in set_to):
        return f"{vessel} is brought to {sorted(set_to)} °C"
    if not set_to and (low_c > warmest or high_c < coldest):
        return f"nothing heats or chills {vessel}, which is between {coldest:g} and {warmest:g} °C"
    state.warmth[vessel] = (low_c, high_c)
    if not set_to:
        state.warmth[vessel] = (max(low_c, coldest), min(high_c, warmest))
    return ""


def _stop_temperature(state: State, action: Action) -> object:
    return state.temperatures.pop(action.device, None)


def _start_vacuum(state: State, action: Action) -> object:
    parameters = action.parameters
    if not isinstance(parameters, words.Pressure):
        return None
    pressure_mbar = parameters.pressure_mbar
    state.vacuums[action.device] = VacuumState(is_running=True, pressure_mbar=pressure_mbar)
    return pressure_mbar


def _stop_vacuum(state: State, action: Action) -> object:
    vacuum = state.vacuums.setdefault(action.device, VacuumState())
    vacuum.is_running = False
    return None


def _vent(state: State, action: Action) -> object:
    vacuum = state.vacuums.setdefault(action.device, VacuumState())
    if vacuum.is_running:
        message = f"{action.device} is vented while it runs"
        state.complain("interpret.vacuum_on", message, device=action.device)
    vacuum.is_vented = True
    return None


def _set_supply(state: State, action: Action) -> object:
    parameters = action.parameters
    if not isinstance(parameters, words.Supply):
        return None
    if parameters.port not in state.plumbing.ports_of(action.device):
        message = f"{action.device} has no tube at {parameters.port!r}"
        state.complain("interpret.unknown_port", message, device=action.device)
    else:
        state.supplies[End(action.device, parameters.port)] = parameters.supply
    return None


def _lower(state: State, action: Action) -> object:
    vessels = vessels_of(state.plumbing, action.device)
    if action.name == "lower_flask":
        state.lowered.update(vessels)
    else:
        state.lowered.difference_update(vessels)
    return None


def _evaporate(state: State, action: Action) -> object:
    parameters = action.parameters
    for vessel in vessels_of(state.plumbing, action.device):
        target = state.plumbing.condenses_in(vessel)
        if target is None:
            message = f"the vapour of {vessel} goes into no one vessel"
            state.complain("interpret.no_path", message, device=action.device)
            return None
        state.record.touched.add(target)
        state.record.vapours.append((vessel, target))
        state.mix_in(target, state.held(vessel).let_go())
    if not isinstance(parameters, words.Boiling):
        return None
    return (parameters.duration_s, parameters.most_s)


def _watch(state: State, action: Action) -> object:
    for vessel in vessels_of(state.plumbing, action.device):
        _set_watch(state, vessel, action.device, is_on=action.name == "watch_boundary")
    return None


def _set_watch(state: State, vessel: str, by: str, *, is_on: bool) -> None:
    watchers = state.watched.setdefault(vessel, set())
    if is_on:
        watchers.add(by)
    else:
        watchers.discard(by)


def _light(state: State, action: Action) -> object:
    parameters = action.parameters
    if isinstance(parameters, words.Light):
        state.lights[action.device] = parameters
        return parameters
    return state.lights.pop(action.device, None)


def _measure(state: State, action: Action) -> object:
    del state
    given = action.parameters
    return (
        (given.quantity, given.low, given.high)
        if isinstance(given, words.MeasuredQuantity)
        else None
    )


def _sound(state: State, action: Action) -> object:
    if action.name == "start_ultrasound":
        state.sounding.add(action.device)
    else:
        state.sounding.discard(action.device)
    return None


def _microwave(state: State, action: Action) -> object:
    del state
    given = action.parameters
    if not isinstance(given, words.Microwave):
        return None
    return (given.temperature_c, given.duration_s, given.power_w)


def _spin(state: State, action: Action) -> object:
    given = action.parameters
    if not isinstance(given, words.Spinning):
        return None
    state.held(action.device).is_layered = True
    return (given.speed_rpm, given.acceleration_g, given.duration_s, given.temperature_c)


def _distill(state: State, action: Action) -> object:
    given = action.parameters
    if not isinstance(given, words.Distilling):
        return None
    joined = vessels_of(state.plumbing, action.device)
    for key in (given.from_, given.to):
        if key not in joined:
            message = f"{action.device} is not joined to {key}"
            state.complain("interpret.no_path", message, device=action.device)
            return None
        state.see_no_vacuum(given.to, f"{action.device} fills {given.to}")
    state.record.vapours.append((given.from_, given.to))
    state.mix_in(given.to, state.held(given.from_).let_go())
    return (given.from_, given.to, given.duration_s, given.vapour_c)


_DEEDS: Mapping[str, Callable[[State, Action], object]] = {
    "wait": _wait,
    "stir": _stir,
    "stop_stirring": _stop_stirring,
    "start_rotation": _stir,
    "stop_rotation": _stop_stirring,
    "set_temperature": _set_temperature,
    "await_temperature": _await_temperature,
    "stop_temperature": _stop_temperature,
    "start_vacuum": _start_vacuum,
    "stop_vacuum": _stop_vacuum,
    "vent": _vent,
    "set_supply": _set_supply,
    "lower_flask": _lower,
    "raise_flask": _lower,
    "evaporate": _evaporate,
    "watch_boundary": _watch,
    "stop_watching": _watch,
    "start_light": _light,
    "stop_light": _light,
    "measure": _measure,
    "start_ultrasound": _sound,
    "stop_ultrasound": _sound,
    "heat_by_microwave": _microwave,
    "spin": _spin,
    "distill": _distill,
}


def _become(state: State, action: Action) -> None:
    """Let what a person has stated come of the lots in a vessel, where they are there."""
    given = action.parameters
    if not isinstance(given, words.Become):
        return
    ends = [given.vessel] if given.to is None else [given.vessel, given.to]
    for key in ends:
        if not state.plumbing.is_vessel(key):
            message = f"{key!r} is no vessel of the graph"
            state.complain("interpret.unknown_vessel", message, vessel=key)
            return
    state.record.touched.update(ends)
    takes = {lot: units(volume_ul) for lot, volume_ul in given.takes.items()}
    gives = {lot: units(volume_ul) for lot, volume_ul in given.gives.items()}
    state.see_there(given.vessel, takes)
    state.held(given.vessel).take_lots(takes)
    take_stated(state, given.vessel, Contents(), given.takes_ug)
    made = {lot: AmountRange.exactly(amount) for lot, amount in gives.items()}
    solids = {lot: AmountRange.exactly(mass_units(ug)) for lot, ug in given.gives_ug.items()}
    volume = AmountRange.exactly(sum(gives.values()))
    state.mix_in(ends[-1], Contents(made, solids, volume))
    value = (dict(given.takes), dict(given.gives), given.takes_ug, given.gives_ug, given.to)
    state.record.effects.append(ProofEffect("become", action.device, (given.vessel,), value))


_OPENS = frozenset(("fill", "add_solid", "empty"))
"""What a person cannot do to a vessel that is under vacuum."""


def _by_hand(state: State, action: Action) -> None:
    parameters = action.parameters
    if isinstance(parameters, words.HandCheck):
        _check(state, action.device, parameters)
        return
    vessel = getattr(parameters, "vessel", "")
    if not state.plumbing.is_vessel(vessel):
        message = f"{vessel!r} is no vessel of the graph"
        state.complain("interpret.unknown_vessel", message, vessel=vessel)
        return
    state.record.touched.add(vessel)
    if action.name in _OPENS:
        state.see_no_vacuum(vessel, f"a person opens {vessel} ({action.name})")
    value, lot = 0, ""
    if isinstance(parameters, words.HandFill):
        value, lot = units(parameters.volume_ul), parameters.lot
        amount = AmountRange.exactly(value)
        state.mix_in(vessel, Contents({lot: amount}, {}, amount))
    elif isinstance(parameters, words.HandSolid):
        value, lot = _solid(state, parameters), parameters.lot
    elif action.name == "empty":
        state.held(REMOVED).add(state.held(vessel).take_everything())
        state.phases.pop(vessel, None)
        state.reactivity.empty(vessel)
    else:
        _set_watch(state, vessel, action.device, is_on=action.name == "watch")
    state.record.effects.append(ProofEffect(action.name, action.device, (vessel,), value, lot))


def _check(state: State, device: str, parameters: words.HandCheck) -> None:
    state.record.effects.append(ProofEffect("check", device, (), parameters.text))
    vessel, least_ul = parameters.vessel, parameters.least_ul
    if vessel is None or least_ul is None:
        state.record.is_checked = True
        return
    if not state.plumbing.is_vessel(vessel):
        message = f"{vessel!r} is no vessel of the graph"
        state.complain("interpret.unknown_vessel", message, vessel=vessel)
        return
    state.record.touched.add(vessel)
    held, least = state.held(vessel), units(least_ul)
    if least > held.volume.most + TOLERANCE:
        message = (
            f"a person is to find {microlitres(least)} in {vessel}, which holds at most "
            f"{microlitres(held.volume.most)}"
        )
        state.complain("interpret.dry_draw", message, vessel=vessel)
        return
    held.find_at_least(min(least, held.volume.most))


def _solid(state: State, parameters: words.HandSolid) -> int:
    value = mass_units(parameters.mass_ug)
    more = Contents({}, {parameters.lot: AmountRange.exactly(value)})
    state.held(parameters.vessel).add(more)
    return value
