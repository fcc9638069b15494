"""Execute what pumps, valves and solenoids do in one group."""

from __future__ import annotations

from dataclasses import dataclass

from labweb.domain.graph.elements import Element, ElementRole
from labweb.domain.messages.plan_fields import Draw, Stroke, ValvePort
from labweb.domain.proof.dissolved_solids import BELOW_THE_FRIT, stop_solids, take_stated
from labweb.domain.proof.lot_amount_ranges import UNITS_PER_NL, Contents
from labweb.domain.proof.plan_read import Action, units
from labweb.domain.proof.plan_state import (
    LOWER,
    TOLERANCE,
    UPPER,
    Flow,
    State,
    Syringe,
    microlitres,
)
from labweb.domain.proof.plumbing import COLLECT, End, is_evaporator

PLUNGER = frozenset(("aspirate", "dispense"))
TURN = frozenset(("set_port", "open", "close"))


@dataclass(frozen=True, slots=True)
class Way:
    """Where one plunger moves liquid from or to, as valves stand."""

    action: Action
    stroke: Stroke
    volume: int
    end: End
    passed: tuple[str, ...]
    """Cartridges and manifolds, in order of flow."""

    ports: frozenset[End]
    """What the flow takes up on its way."""


def turn(state: State, action: Action) -> None:
    """Turn one valve or switch one solenoid."""
    element = state.plumbing.elements[action.device]
    if isinstance(action.parameters, ValvePort):
        port = action.parameters.port
        if not state.plumbing.can_turn(element, port):
            state.complain(
                "interpret.unknown_port",
                f"{action.device} cannot be turned to {port!r}",
                device=action.device,
            )
            return
        state.stands.ports[action.device] = port
        state.record.turned.add(action.device)
    elif action.name == "open":
        state.stands.opened.add(action.device)
        state.record.opened.add(action.device)
    else:
        state.stands.opened.discard(action.device)


def move(state: State, actions: list[Action]) -> None:
    """Move all plungers of one group."""
    found = [way for action in actions if (way := _find_way(state, action)) is not None]
    _check_crossing(state, found)
    by_pump = {way.action.device: way for way in found}
    ends: dict[str, str] = {}
    for way in found:
        state.record.rates.append((way.action.device, _leads(state, way), way.stroke.rate_ul_s))
        if way.end.key in state.syringes or _is_pump(state, way.end.key):
            partner = by_pump.get(way.end.key)
            if not _is_pass(state, way, partner):
                continue
            if way.action.name == "aspirate" and partner is not None:
                _hand_over(state, giver=partner, taker=way)
        elif ends.setdefault(way.end.key, way.action.name) != way.action.name:
            state.complain(
                "interpret.both_ways",
                f"{way.end.key} is drawn from and filled at the same time",
                device=way.action.device,
            )
        elif way.action.name == "aspirate":
            _draw(state, way)
        else:
            _push(state, way)


def _leads(state: State, way: Way) -> str:
    """Return which of the rates of a request a stroke has: a cartridge is passed as one draws."""
    elements = state.plumbing.elements
    if any(elements[key].role is ElementRole.CARTRIDGE for key in way.passed):
        return "draw"
    if _is_pump(state, way.end.key):
        return "between"
    return "draw" if way.action.name == "aspirate" else "push"


def _find_way(state: State, action: Action) -> Way | None:
    stroke = action.parameters
    if not isinstance(stroke, Stroke):
        return None
    plumbing, pump = state.plumbing, state.plumbing.elements[action.device]
    pushing = action.name == "dispense"
    state.record.touched.add(action.device)
    tubes = plumbing.tubes_at(action.device, pushing=pushing)
    if pump.selects:
        port = _stand(state, pump)
        if port is None:
            return None
        tubes = [tube for tube in tubes if tube[0] == port]
    passed: list[str] = []
    taken: list[End] = []
    here, start = action.device, End(action.device, tubes[0][0] if tubes else "")
    while True:
        tube = _only(state, action.device, here, tubes)
        if tube is None or tube[1] in taken:
            return None
        left, far = End(here, tube[0]), tube[1]
        taken.append(far)
        element = plumbing.elements[far.key]
        state.record.touched.add(far.key)
        if element.role in (ElementRole.VESSEL, ElementRole.GAS, ElementRole.PUMP):
            state.record.ways.append((start, *taken))
            return _arrive(state, action, far, tuple(passed), frozenset(taken))
        leave = _leave(state, element, far)
        if leave is None:
            return None
        if element.role in (ElementRole.CARTRIDGE, ElementRole.MANIFOLD):
            passed.append(far.key)
        taken += [End(far.key, port) for port in sorted(leave) if port]
        # Whatever else is joined to the port that liquid comes by, it flows there as well.
        joined = leave | {far.port}
        tubes = [
            tube
            for tube in plumbing.tubes_at(far.key, pushing=pushing)
            if tube[0] in joined and tube != (far.port, left)
        ]
        here = far.key


def _stand(state: State, valve: Element) -> str | None:
    """Return where a valve stands that this step has turned."""
    stand = state.stands.ports.get(valve.key)
    if stand is None or valve.key not in state.record.turned:
        message = f"this step moves liquid through {valve.key} and has not turned it"
        state.complain("interpret.valve_unset", message, device=valve.key)
    return stand


def _only(
    state: State, pump: str, key: str, tubes: list[tuple[str, End]]
) -> tuple[str, End] | None:
    """Return the tube that liquid takes; a solenoid that is shut ends a tube."""
    shut = [tube for tube in tubes if state.plumbing.is_shut(tube[1].key, state.stands)]
    ways = [tube for tube in tubes if tube not in shut] or shut
    state.record.touched.update(end.key for _, end in shut)
    if len(ways) == 1:
        return ways[0]
    if not ways:
        message = f"{pump} reaches {key}, and no tube leads on"
        state.complain("interpret.no_path", message, device=pump)
    else:
        far = ", ".join(sorted(end.key for _, end in ways))
        message = f"{pump} reaches {key}, where the flow divides between {far}"
        state.complain("interpret.divides", message, device=pump)
    return None


def _leave(state: State, element: Element, entered: End) -> set[str] | None:
    """Return the ports by which liquid goes on; None: it does not."""
    plumbing = state.plumbing
    if element.role is ElementRole.VALVE and _stand(state, element) is None:
        return None
    if element.role is ElementRole.SOLENOID:
        state.record.solenoids.add(element.key)
    elif element.role not in (ElementRole.VALVE, ElementRole.CARTRIDGE, ElementRole.MANIFOLD):
        message = f"liquid would go to {element.key}, which is no vessel"
        state.complain("interpret.no_vessel", message, device=element.key)
        return None
    leave = plumbing.passes(element, entered, state.stands)
    if leave is None:
        return {port for port, _ in plumbing.tubes_at(element.key, pushing=True)} | {
            port for port, _ in plumbing.tubes_at(element.key, pushing=False)
        }
    if not leave:
        message = f"{element.key} is shut to {entered.port!r}"
        state.complain("interpret.no_path", message, device=element.key)
        return None
    return leave


def _arrive(
    state: State, action: Action, end: End, passed: tuple[str, ...], taken: frozenset[End]
) -> Way | None:
    element = state.plumbing.elements[end.key]
    stroke = action.parameters
    if not isinstance(stroke, Stroke):
        return None
    volume = units(stroke.volume_ul)
    if action.name == "aspirate":
        passed = passed[::-1]
    if element.role is ElementRole.PUMP:
        if element.selects and _stand(state, element) != end.port:
            message = f"{end.key} does not stand at {end.port!r}"
            state.complain("interpret.no_path", message, device=end.key)
            return None
        return Way(action, stroke, volume, end, passed, taken)
    if state.has_collecting and is_evaporator(element) and end.port == "collect":
        end = End(end.key + COLLECT, end.port)
        state.record.touched.add(end.key)
    if action.name == "dispense" and state.plumbing.is_gas(element.key):
        message = f"{action.device} would push into {end.key}, a source of gas"
        state.complain("interpret.no_vessel", message, device=action.device)
        return None
    state.see_no_vacuum(end.key, f"{action.device} moves liquid at {end.key}")
    return Way(action, stroke, volume, end, passed, taken)


def _check_crossing(state: State, ways: list[Way]) -> None:
    used: dict[End, str] = {}
    for way in ways:
        for port in way.ports:
            if state.plumbing.elements[port.key].role in (ElementRole.VESSEL, ElementRole.GAS):
                continue
            other = used.setdefault(port, way.action.device)
            if other in (way.action.device, way.end.key):
                continue
            message = f"{way.action.device} and {other} both move liquid through {port.key}"
            state.complain("interpret.crossing", message, device=way.action.device)


def _is_pump(state: State, key: str) -> bool:
    element = state.plumbing.elements.get(key)
    return element is not None and element.role is ElementRole.PUMP


def _is_pass(state: State, way: Way, partner: Way | None) -> bool:
    """Tell whether the plunger at the other end moves with this one."""
    fits = (
        partner is not None
        and partner.end.key == way.action.device
        and partner.action.name != way.action.name
        and partner.volume == way.volume
        and partner.stroke.rate_ul_s == way.stroke.rate_ul_s
    )
    if not fits:
        message = (
            f"{way.action.device} is joined to the syringe {way.end.key}, which does not move "
            "with it by the same volume at the same rate"
        )
        state.complain("interpret.unequal_pass", message, device=way.action.device)
    return fits


def _hand_over(state: State, *, giver: Way, taker: Way) -> None:
    source = state.syringe(giver.action.device)
    passed = source.passed + tuple(part for part in taker.passed)
    origin, phases, is_dissolved = source.origin, set(source.phases), source.is_dissolved
    taken = _push_out(state, giver)
    if taken is not None and origin is not None:
        stop_solids(state, taken, taker.passed, is_dissolved=is_dissolved)
        as_of = Syringe(0, Contents(), origin, passed, phases, is_dissolved)
        _take_in(state, taker, taken, as_of)


def _draw(state: State, way: Way) -> None:
    key = way.end.key
    if state.plumbing.is_gas(key):
        _take_in(state, way, Contents(), Syringe(0, Contents(), way.end, way.passed))
        return
    stroke, held = way.stroke, state.held(key)
    if isinstance(stroke, Draw):
        draw = stroke
    else:
        draw = Draw(volume_ul=stroke.volume_ul, rate_ul_s=stroke.rate_ul_s)
    phases = {LOWER} if draw.until == "boundary" else set(state.phases.get(key, ()))
    if draw.until is None and way.volume > held.volume.least + TOLERANCE:
        state.complain(
            "interpret.dry_draw",
            f"{way.action.device} draws {microlitres(way.volume)} from {key}, which holds for "
            f"certain {microlitres(held.volume.least)}",
            vessel=key,
        )
    taken = _taken(state, way, draw, held)
    is_dissolved = draw.solids is not None
    take_stated(state, key, taken, draw.solids or {})
    stop_solids(state, taken, way.passed, is_dissolved=is_dissolved)
    as_of = Syringe(0, Contents(), way.end, way.passed, phases, is_dissolved)
    _take_in(state, way, taken, as_of)


def _taken(state: State, way: Way, draw: Draw, held: Contents) -> Contents:
    """Take out of a vessel what a stroke draws: up to a boundary, as stated, or of all a share."""
    key = way.end.key
    if draw.until == "boundary":
        return _draw_lower(state, way, held)
    if draw.of is not None:
        parts = {lot: units(volume_ul) for lot, volume_ul in draw.of.items()}
        state.see_there(key, parts)
        if sum(parts.values()) != way.volume:
            message = f"{way.action.device} draws another volume than that of the lots it names"
            state.complain("interpret.unclaimed", message, vessel=key)
        return held.take_lots(parts)
    element = state.plumbing.elements.get(key)
    is_filter = element is not None and "filter" in element.kind.lower()
    stays = draw.solids is not None or (is_filter and way.end.port == BELOW_THE_FRIT)
    taken = held.take(way.volume, with_solids=not stays)
    if not held.volume.most:
        state.phases.pop(key, None)
    return taken


def _draw_lower(state: State, way: Way, held: Contents) -> Contents:
    key = way.end.key
    element = state.plumbing.elements.get(key)
    if not state.watched.get(key):
        message = f"nobody watches the boundary in {key}"
        state.complain("interpret.not_watched", message, vessel=key)
    if element is not None and element.leave_by not in (None, way.end.port):
        message = f"the lower phase of {key} does not leave by {way.end.port!r}"
        state.complain("interpret.not_watched", message, vessel=key)
    most, drawn = state.record.parting.get(key, (held.volume.most, 0))
    state.record.parting[key] = (most, drawn + way.volume)
    is_parted = drawn + way.volume >= most - TOLERANCE
    state.phases[key] = {UPPER} if is_parted else {LOWER, UPPER}
    return held.take_lower_phase(way.volume)


def _take_in(state: State, way: Way, taken: Contents, as_of: Syringe) -> None:
    syringe = state.syringe(way.action.device)
    if syringe.nominal and (syringe.origin, syringe.passed) != (as_of.origin, as_of.passed):
        state.complain(
            "interpret.meets",
            f"{way.action.device} still holds what it drew from "
            f"{syringe.origin and syringe.origin.key} when it draws from "
            f"{as_of.origin and as_of.origin.key}",
            device=way.action.device,
        )
    _wet(state, way, taken, as_of.origin)
    syringe.origin, syringe.passed = as_of.origin, as_of.passed
    syringe.phases |= as_of.phases
    syringe.is_dissolved = as_of.is_dissolved
    syringe.nominal += way.volume
    syringe.contents.add(taken)
    capacity_nl = state.plumbing.elements[way.action.device].capacity_nl
    if capacity_nl is None:
        message = f"nobody says how much {way.action.device} holds"
        state.complain("interpret.unknown_syringe", message, device=way.action.device)
    elif syringe.nominal > capacity_nl * UNITS_PER_NL:
        message = f"{way.action.device} would hold {microlitres(syringe.nominal)}"
        state.complain("interpret.overfull", message, device=way.action.device)


def _wet(
    state: State, way: Way, taken: Contents, origin: End | None, *, is_drawn: bool = True
) -> None:
    """Let liquid go over the valves of its way, and over the syringe that draws it."""
    keys = {end.key for end in way.ports} | ({way.action.device} if is_drawn else set())
    for key in sorted(keys - {way.end.key}):
        for found in state.reactivity.pass_over(key, taken, origin.key if origin else ""):
            state.complain(found.code, found.message, device=key)


def _push_out(state: State, way: Way) -> Contents | None:
    syringe = state.syringe(way.action.device)
    if way.volume > syringe.nominal:
        state.complain(
            "interpret.pushes_more",
            f"{way.action.device} pushes {microlitres(way.volume)} and holds "
            f"{microlitres(syringe.nominal)}",
            device=way.action.device,
        )
        return None
    syringe.nominal -= way.volume
    if syringe.nominal:
        return syringe.contents.take(way.volume)
    taken = syringe.contents
    state.syringes[way.action.device] = Syringe()
    return taken


def _push(state: State, way: Way) -> None:
    syringe = state.syringe(way.action.device)
    origin, passed, phases = syringe.origin, syringe.passed + way.passed, set(syringe.phases)
    is_dissolved = syringe.is_dissolved
    taken = _push_out(state, way)
    if taken is None or origin is None:
        return
    stop_solids(state, taken, way.passed, is_dissolved=is_dissolved)
    is_gas = state.plumbing.is_gas(origin.key)
    state.record.flows.append(
        Flow(origin, way.end, taken.volume, way.volume, passed, taken.liquids, taken.solids, is_gas)
    )
    _wet(state, way, taken, origin, is_drawn=False)
    for found in state.reactivity.pour(way.end.key, taken):
        state.complain(found.code, found.message, vessel=way.end.key)
    state.mix_in(way.end.key, taken)
    if taken.volume.most:
        state.phases.setdefault(way.end.key, set()).update(phases)
