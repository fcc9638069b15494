"""Execute a whole plan and list everything that is not proved."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import chain

from labweb.domain.errors import Finding
from labweb.domain.graph.elements import ElementRole
from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.graph.rig.stated_volumes import check_volumes
from labweb.domain.messages.plan_fields import BY_HAND, DECLARED, TIMER
from labweb.domain.messages.step_claims import Claim
from labweb.domain.proof.actions_of_devices_and_people import act
from labweb.domain.proof.claim_check import check_claim
from labweb.domain.proof.device_abilities import abilities, vessels_of
from labweb.domain.proof.gas_and_vacuum import FOR_GAS, Before
from labweb.domain.proof.incompatible_liquids import Came, Reactivity
from labweb.domain.proof.lot_amount_ranges import NOTHING, Contents
from labweb.domain.proof.plan_read import Action, ProofPlan, ProofStep
from labweb.domain.proof.plan_state import (
    LOWER,
    TOLERANCE,
    UPPER,
    State,
    StepRecord,
    microlitres,
)
from labweb.domain.proof.plumbing import COLLECT, Plumbing
from labweb.domain.proof.pumps_and_valves import PLUNGER, TURN, move, turn
from labweb.domain.proof.rounds_until_reading import Rounds
from labweb.domain.proof.totals_and_order import check_after, check_totals
from labweb.domain.proof.tube_filling import check_filling
from labweb.domain.proof.unplanned_mixing import amounts


def check_plan(rig: Rig, plan: ProofPlan, graph_sha256: str = "") -> list[Finding]:
    """Execute a plan on a rig; an empty list means that all it claims is proved.

    Args:
        rig: The graph the plan was made for.
        plan: The plan. None of its claims is trusted.
        graph_sha256: Digest of the bytes of the graph; empty: it is not compared.

    Effect:
        None. Nothing moves: the plan is executed on paper.
    """
    return execute(rig, plan, graph_sha256).findings


def execute(rig: Rig, plan: ProofPlan, graph_sha256: str = "") -> State:
    """Execute a plan and return the state that it ends in, with all findings."""
    plumbing = Plumbing(rig)
    stated = _stated_capacities(plumbing)
    state = State(plumbing, stated | dict(plan.capacities))
    if graph_sha256 and plan.graph_sha256 not in (None, graph_sha256):
        message = "the plan was made for another graph: the SHA-256 differ"
        state.complain("interpret.other_graph", message)
    for key, amount in plan.capacities.items():
        known = stated.get(key)
        if known is not None and amount > known + TOLERANCE:
            message = (
                f"{key} is said to hold {microlitres(amount)}; the graph says {microlitres(known)}"
            )
            state.complain("interpret.capacity", message, vessel=key)
    state.reactivity = Reactivity(plumbing.elements, plan, _condensing(plumbing))
    state.findings += [*check_volumes(rig), *state.reactivity.check_declared(plan)]
    _check_vessels(state, plan)
    _check_stated(state, plan)
    _fill_before(state, plan)
    records, rounds = [], Rounds(state)
    for step in plan.steps:
        state.where = f"step {step.id}"
        rounds.begin(step)
        records.append(_execute_step(state, step))
        state.routes[step.id] = plumbing.tubes_of(records[-1].ways)
    state.where = "end"
    rounds.finish()
    _check_stopped(state)
    state.findings += check_after(plan.steps, [record.touched for record in records])
    state.findings += check_totals(plan, records)
    state.findings += check_filling(plan, plumbing, records)
    state.findings = _unique(state.findings)
    return state


def execute_alone(plumbing: Plumbing, step: ProofStep, contents: Mapping[str, Contents]) -> State:
    """Execute a transfer without a recipe, whose one record is the last of the state.

    Vessels have no bound, no vacuum runs, and a rotary evaporator is one vessel.
    """
    state = State(plumbing, {}, is_alone=True)
    state.contents = {key: held.copy() for key, held in contents.items()}
    _execute_step(state, step)
    state.where = "end"
    _check_stopped(state)
    state.findings = _unique(state.findings)
    return state


def _unique(findings: list[Finding]) -> list[Finding]:
    return list({(finding.code, finding.message): finding for finding in findings}.values())


def _stated_capacities(plumbing: Plumbing) -> dict[str, int]:
    vessels = [key for key in plumbing.elements if plumbing.is_vessel(key)]
    vessels += [key + COLLECT for key in vessels if plumbing.is_vessel(key + COLLECT)]
    found = {key: plumbing.capacity(key) for key in vessels}
    return {key: amount for key, amount in found.items() if amount is not None}


def _check_vessels(state: State, plan: ProofPlan) -> None:
    known = {*state.plumbing.elements, *filter(state.plumbing.is_vessel, plan.capacities)}
    named = (
        ("contents", {*plan.contents} - {*filter(state.plumbing.is_vessel, plan.contents)}),
        ("capacities_ul", plan.capacities.keys() - known),
        ("bindings.vessels", {*plan.bindings.vessels.values()} - known),
        ("bindings.reagents", plan.flasks() - known),
    )
    for place, keys in named:
        for key in sorted(keys):
            message = f"{place} names {key!r}, which is no vessel of the graph"
            state.complain("interpret.unknown_vessel", message, vessel=key)


def _check_stated(state: State, plan: ProofPlan) -> None:
    """Add a finding for what the graph says is there and the plan does not begin with.

    A plan may begin with more: what somebody states beside the graph. What is in the flask of a
    reagent is that reagent, whatever the graph calls it.
    """
    for key, element in sorted(state.plumbing.elements.items()):
        is_vessel = state.plumbing.is_vessel(key)
        if not is_vessel and element.role is not ElementRole.PUMP:
            continue
        total, named = state.plumbing.stated(key)
        if not is_vessel and total:
            message = f"the graph says that {microlitres(total)} are in the syringe {key}"
            state.complain("interpret.syringe_not_empty", message, device=key)
        elif is_vessel:
            held = plan.contents.get(key, Contents())
            wanted = {} if key in plan.flasks() else named
            pairs = [("liquid", total, held.volume.least)]
            pairs += [(n, nl, held.liquids.get(n, NOTHING).least) for n, nl in wanted.items()]
            for name, said, begun in pairs:
                if begun < said - TOLERANCE:
                    message = (
                        f"the graph says that {microlitres(said)} of {name} are in {key}, and the "
                        f"plan begins with {microlitres(begun)}"
                    )
                    state.complain("interpret.contents", message, vessel=key)
                    break


def _fill_before(state: State, plan: ProofPlan) -> None:
    for key, contents in plan.contents.items():
        state.contents[key] = contents.copy()
        state.reactivity.fill_before(key, contents)
        capacity = state.capacities.get(key)
        if capacity is not None and contents.volume.least > capacity + TOLERANCE:
            message = f"{key} holds more than it can before the first step"
            state.complain("interpret.overflow", message, vessel=key)


def _execute_step(state: State, step: ProofStep) -> StepRecord:
    state.where = f"step {step.id}"
    state.record = record = StepRecord()
    both = {LOWER, UPPER}
    state.phases = {str(step.claim.vessel): both} if step.claim.kind == "separate" else {}
    before = Before(
        contents={key: contents.copy() for key, contents in state.contents.items()},
        sources={key: state.sources(key) for key in state.exposed},
        vacuum={key: state.running_vacuum(key) for key in state.exposed},
        may_draw={key: state.running_vacuum(key, maybe=True) for key in state.exposed},
        lines={key: state.lines(key) for key in state.exposed},
    )
    ends = (step.claim.to, step.claim.lower_to, step.claim.upper_to)
    state.reactivity.begin(before.contents, [key for key in ends if key is not None])
    for group in step.groups:
        _execute_group(state, group)
    _conserve(state, before)
    for found in state.reactivity.finish(_came(state, before), state.contents):
        state.complain(found.code, found.message, vessel=found.subject)
    for key, syringe in sorted(state.syringes.items()):
        if syringe.nominal:
            message = f"{key} ends with {microlitres(syringe.nominal)} in it"
            state.complain("interpret.syringe_not_empty", message, device=key)
    opened = record.solenoids | (set() if step.claim.kind in FOR_GAS else record.opened)
    for key in sorted(opened & state.stands.opened):
        state.complain("interpret.solenoid_open", f"{key} is left open", device=key)
    record.touched.update(_places(step.claim))
    if all(_is_place(state, key) for key in _places(step.claim)):
        check_claim(state, step.claim, before)
    return record


def _conserve(state: State, before: Before) -> None:
    """Bound each lot that a step moved by what there was before it."""
    if any(effect.name in ("fill", "add_solid") for effect in state.record.effects):
        return
    flows = [flow for flow in state.record.flows if not flow.is_gas]
    sources = {flow.source.key for flow in flows}
    for key in sources | {flow.target.key for flow in flows}:
        limit = before.contents.get(key, Contents()).copy()
        for other in sources - {key}:
            limit.add(before.contents.get(other, Contents()))
        state.held(key).keep_within(limit)
    _keep_all(state, before, sources | {flow.target.key for flow in flows})


def _keep_all(state: State, before: Before, keys: set[str]) -> None:
    """Bound each liquid from below: what is in no other vessel of the step is in this one.

    Not where some of it may have gone elsewhere: by vacuum, as vapour, or by hand.
    """
    is_open = any(effect.name == "empty" for effect in state.record.effects)
    is_dried = any(before.may_draw.get(k) or state.running_vacuum(k, maybe=True) for k in keys)
    if is_open or is_dried or state.record.vapours:
        return
    held = [before.contents.get(key, Contents()).liquids for key in keys]
    least = {lot: sum(h.get(lot, NOTHING).least for h in held) for lot in {*chain(*held)}}
    most = {
        lot: sum(state.held(key).liquids.get(lot, NOTHING).most for key in keys) for lot in least
    }
    for key in keys:
        own = state.held(key)
        own.keep_at_least(
            {lot: least[lot] - most[lot] + r.most for lot, r in own.liquids.items() if lot in least}
        )


def _condensing(plumbing: Plumbing) -> set[str]:
    """Return the vessels that vapour of a rotary evaporator runs into."""
    makers = [key for key, e in plumbing.elements.items() if "evaporate" in abilities(e)]
    ends = (plumbing.condenses_in(v) for key in makers for v in vessels_of(plumbing, key))
    return {end for end in ends if end is not None}


def _came(state: State, before: Before) -> dict[str, Came]:
    """Return what came into each vessel in a step: no more of a lot than there was."""
    flows, found = state.record.flows, dict[str, Came]()
    sources = {flow.source.key for flow in flows if not flow.is_gas}
    for flow in flows:
        got = dict(found[flow.target.key].amounts) if flow.target.key in found else {}
        for item, most in amounts(Contents(dict(flow.liquids), dict(flow.solids))).items():
            there = [amounts(before.contents.get(key, Contents())).get(item, 0) for key in sources]
            got[item] = min(got.get(item, 0) + most, sum(there))
        got = {item: amount for item, amount in got.items() if amount}
        found[flow.target.key] = Came(got, sources or {flow.source.key})
    for source, target in state.record.vapours:
        gone = amounts(Contents(before.contents.get(source, Contents()).liquids))
        found[target] = Came(gone, (source,))
    for effect in state.record.effects:
        if effect.name in ("fill", "add_solid") and isinstance(effect.value, int):
            item = (effect.lot, effect.name == "add_solid")
            found[effect.vessels[0]] = Came({item: effect.value})
    return found


def _places(claim: Claim) -> Iterator[str]:
    named = (claim.vessel, claim.from_, claim.to, claim.lower_to, claim.upper_to)
    for key in (*named, *(claim.also or ())):
        if key is not None:
            yield key


def _is_place(state: State, key: str) -> bool:
    if state.plumbing.is_vessel(key) or state.plumbing.is_gas(key):
        return True
    message = f"its claim names {key!r}, which is no vessel of the graph"
    state.complain("interpret.unknown_vessel", message, vessel=key)
    return False


def _execute_group(state: State, group: tuple[Action, ...]) -> None:
    known = [action for action in group if _has_device(state, action)]
    turning = [action for action in known if action.name in TURN]
    moving = [action for action in known if action.name in PLUNGER]
    if turning and moving:
        message = f"{turning[0].device} is turned while {moving[0].device} moves liquid"
        state.complain("interpret.turned_while_moving", message, device=turning[0].device)
    seen: set[tuple[str, str]] = set()
    for action in known:
        sort = "" if action.name in TURN | PLUNGER else action.name
        if action.device != BY_HAND and (action.device, sort) in seen:
            message = f"{action.device} is asked for two things at once"
            state.complain("interpret.device_twice", message, device=action.device)
        seen.add((action.device, sort))
    for action in turning:
        state.record.touched.add(action.device)
        turn(state, action)
    unique = {action.device: action for action in moving}
    move(state, list(unique.values()))
    for action in known:
        if action.name not in TURN | PLUNGER:
            act(state, action)
    state.dry()


def _has_device(state: State, action: Action) -> bool:
    if action.device in (BY_HAND, TIMER, DECLARED):
        return True
    element = state.plumbing.elements.get(action.device)
    if element is None:
        message = f"{action.device!r} is not in the graph"
        state.complain("interpret.unknown_device", message, device=action.device)
        return False
    if action.name not in abilities(element):
        message = f"{action.device}, a {element.kind or element.role}, cannot {action.name}"
        state.complain("interpret.unknown_action", message, device=action.device)
        return False
    return True


def _check_stopped(state: State) -> None:
    """Add a finding for everything that still runs."""
    running = chain(
        ((key, "stirs") for key in state.stirring),
        ((key, "rotates") for key in state.rotating),
        ((key, "heats or chills") for key in state.temperatures),
        ((key, "draws vacuum") for key in state.running_pumps()),
        ((key, "gives light") for key in state.lights),
        ((key, "gives ultrasound") for key in state.sounding),
        ((end.key, f"supplies {s}") for end, s in state.supplies.items() if s != "none"),
        ((key, "is watched") for key, by in state.watched.items() if by),
    )
    for key, what in running:
        state.complain("interpret.left_running", f"{key} still {what}", device=key)
    stands, state.stands = state.stands, type(state.stands)()
    at_first = {key: (state.sources(key), state.running_vacuum(key)) for key in state.exposed}
    state.stands = stands
    for key in state.exposed:
        sources, vacuum = at_first[key]
        for other in sorted((state.sources(key) - sources) | (state.running_vacuum(key) - vacuum)):
            message = f"{key} is still joined to {other}"
            state.complain("interpret.left_running", message, vessel=key)
