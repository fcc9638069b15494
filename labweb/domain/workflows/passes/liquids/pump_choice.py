"""Which pump can move liquid from here to there, and through which valve positions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from uuid import UUID

from labweb.domain.calibration.correction import CalibrationQuantity
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.errors import Finding, NoRouteError
from labweb.domain.graph.ports_and_connections import Connection, Medium, PortRef
from labweb.domain.graph.routing import Route, find_route, is_numbered
from labweb.domain.resources.resource_kinds import is_vessel
from labweb.domain.units import parse
from labweb.domain.workflows.passes.devices.calibration_correction import (
    check_accuracy,
    largest_stroke_nl,
)
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.passes.liquids.stroke_splitting import count_strokes, split_strokes
from labweb.domain.workflows.passes.role_requirements import acting_node, plays, setting
from labweb.domain.workflows.workflow_file import Step

MOST_STROKES = 500
"""Most strokes that one transfer is planned with."""


@dataclass(frozen=True, slots=True)
class ValveTurn:
    """A valve that must stand at a port, and the device that turns it."""

    device: AdmittedDevice
    node_id: UUID
    port_index: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """One half of a transfer: into the syringe, or out of it."""

    route: Route
    turns: tuple[ValveTurn, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Pumping:
    """A pump with its two legs."""

    device: AdmittedDevice
    pump_id: UUID
    into: Leg
    out: Leg

    @property
    def dead_volume_nl(self) -> int:
        """Return what both legs waste, as far as it is known."""
        return self.into.route.dead_volume_nl + self.out.route.dead_volume_nl


def pump_node(view: PlannerView, device: AdmittedDevice) -> UUID | None:
    """Return the syringe of a device that can pump, or None when it cannot."""
    if not plays(device, "pump"):
        return None
    node_id = device.nodes.get("pump")
    nodes = [node_id] if node_id is not None else sorted(set(device.nodes.values()))
    syringes = [
        n for n in nodes if n in view.tree.by_id and view.tree.by_id[n].kind == "syringe_pump"
    ]
    return syringes[0] if len(syringes) == 1 else None


def check_share(
    step: Step, view: PlannerView, device: AdmittedDevice, pump_id: UUID, amount_nl: int
) -> list[Finding]:
    """List why a pump is not known to be as accurate as the step needs, stroke by stroke."""
    if "accuracy" not in step.params:
        return []
    state = view.state(pump_id)
    syringe_nl = 0 if state is None else state.capacity_nl or 0
    stroke_nl = largest_stroke_nl(device, syringe_nl)
    is_planned = stroke_nl > 0 and count_strokes(amount_nl, stroke_nl) <= MOST_STROKES
    parts = split_strokes(amount_nl, stroke_nl) if is_planned else (amount_nl,)
    volumes_ul = [part / 1000 for part in sorted(set(parts))]
    wanted = parse(step.params["accuracy"], "share")
    return check_accuracy(device, CalibrationQuantity.VOLUME, volumes_ul, wanted)


def pump_nodes(
    devices: Iterable[AdmittedDevice], view: PlannerView
) -> list[tuple[AdmittedDevice, UUID]]:
    """Return those of the devices that can pump, with the syringe of each."""
    return [(device, node) for device in devices if (node := pump_node(view, device)) is not None]


def choose_pump(  # noqa: PLR0913 - what is moved, and by which way it may go
    view: PlannerView,
    source: UUID,
    target: UUID,
    amount_nl: int,
    wanted: AdmittedDevice | None,
    *,
    through: UUID | None = None,
    check: Callable[[Pumping], list[Finding]] = lambda _: [],
) -> Pumping | Finding:
    """Find the pump that wastes least; ties go to the device whose key sorts first.

    One whose syringe is so small that it takes too many strokes is chosen last. One of which
    `check` lists findings is not chosen.

    Returns:
        The pump with its legs, or the finding that says why no single pump can do it.
        The finding's subject is left empty.
    """
    pumps = pump_nodes(view.devices_by_key if wanted is None else (wanted,), view)
    if not pumps:
        whose = "no device of this lab is" if wanted is None else f"{wanted.name} is not"
        return Finding("plan.no_device", f"{whose} a driven syringe pump")
    found: list[Pumping] = []
    reasons: list[Finding] = []
    for device, node_id in pumps:
        answer = _try_pump(view, device, node_id, source, target, through)
        problems = check(answer) if isinstance(answer, Pumping) else [answer]
        if isinstance(answer, Pumping) and not problems:
            found.append(answer)
        reasons += problems
    if found:
        return min(
            found,
            key=lambda p: (
                _is_too_small(view, p.pump_id, amount_nl),
                p.dead_volume_nl,
                p.device.key,
                p.device.id,
            ),
        )
    return _why_not(view, source, target, reasons, [node_id for _, node_id in pumps])


def _is_too_small(view: PlannerView, pump_id: UUID, amount_nl: int) -> bool:
    state = view.state(pump_id)
    syringe_nl = None if state is None else state.capacity_nl
    return syringe_nl is not None and amount_nl > MOST_STROKES * syringe_nl


def _try_pump(
    view: PlannerView,
    device: AdmittedDevice,
    pump_id: UUID,
    source: UUID,
    target: UUID,
    through: UUID | None,
) -> Pumping | Finding:
    try:
        into = find_route(view.graph, view.tree, source, pump_id)
        out = find_way(view, pump_id, target, through)
    except NoRouteError as error:
        return Finding(error.code, error.message, "", error.context)
    problem = _check_pump_ports(view, device, pump_id, (into.ports[-1], out.ports[0]))
    if problem is not None:
        return problem
    legs = []
    for route in (into, out):
        leg = make_leg(view, route, {pump_id: device})
        if isinstance(leg, Finding):
            return leg
        legs.append(leg)
    return Pumping(device=device, pump_id=pump_id, into=legs[0], out=legs[1])


def make_leg(
    view: PlannerView, route: Route, pumps: Mapping[UUID, AdmittedDevice]
) -> Leg | Finding:
    """Return a way with all that is turned for it, the valves of the syringes at its ends too.

    Args:
        view: The lab.
        route: The way.
        pumps: By syringe, the device that moves it.

    Returns:
        The leg, or a finding whose subject is left empty.
    """
    for end in (route.ports[0], route.ports[-1]):
        device = pumps.get(end.resource_id)
        if device is None:
            continue
        is_drawn = end is route.ports[-1]
        problem = _check_pump_ports(view, device, end.resource_id, (end,), draws=is_drawn)
        if problem is not None:
            return problem
    turns = _turns(view, route, pumps)
    return turns if isinstance(turns, Finding) else Leg(route=route, turns=turns)


def find_way(view: PlannerView, source: UUID, target: UUID, through: UUID | None) -> Route:
    """Find the way between two ends; through a cartridge only when that is asked.

    Raises:
        NoRouteError: There is none.
    """
    if through is None:
        return find_route(view.graph, view.tree, source, target)
    near = find_route(view.graph, view.tree, source, through)
    far = find_route(view.graph, view.tree, through, target)
    return Route(
        (*near.ports, *far.ports),
        (*near.connections, *far.connections),
        (*near.valves, *far.valves),
        near.dead_volume_nl + far.dead_volume_nl,
    )


def find_outlet(
    view: PlannerView, device: AdmittedDevice, pump_id: UUID, target: UUID
) -> Leg | Finding:
    """Find the way out of one pump's syringe, or say why there is none.

    Returns:
        The leg, or a finding whose subject is left empty.
    """
    try:
        out = find_route(view.graph, view.tree, pump_id, target)
    except NoRouteError as error:
        return Finding(error.code, error.message, "", error.context)
    return make_leg(view, out, {pump_id: device})


def _check_pump_ports(
    view: PlannerView,
    device: AdmittedDevice,
    pump_id: UUID,
    ends: Iterable[PortRef],
    *,
    draws: bool = True,
) -> Finding | None:
    """Refuse a syringe that would draw from, or push into, more than one tube."""
    is_numbered_all = all(is_numbered(end.port) for end in ends)
    if is_numbered_all and _selects(device, pump_id):
        return None
    tubes = view.graph.restricted(Medium.LIQUID).by_resource.get(pump_id, [])
    ways_in = sum(_leads(connection, pump_id, inwards=True) for connection in tubes)
    ways_out = sum(_leads(connection, pump_id, inwards=False) for connection in tubes)
    if ways_out == 1 and (ways_in == 1 or not draws):
        return None
    if is_numbered_all:
        message = f"{device.name} has numbered ports, but its driver cannot select one"
        return Finding("plan.no_device", message)
    message = (
        f"{device.name} has {len(tubes)} tubes and no valve of its own between them: "
        f"where the liquid {'comes from' if draws else 'goes'} cannot be chosen"
    )
    return Finding("plan.ambiguous_port", message, "", {"tubes": [c.key for c in tubes]})


def _selects(device: AdmittedDevice, node_id: UUID) -> bool:
    """Tell whether a device's `select_port` turns this very resource."""
    return plays(device, "valve") and acting_node(device, "select_port") == node_id


def _leads(connection: Connection, pump_id: UUID, *, inwards: bool) -> bool:
    if connection.is_two_way:
        return True
    end = connection.target if inwards else connection.source
    return end.resource_id == pump_id


def _turns(
    view: PlannerView, route: Route, pumps: Mapping[UUID, AdmittedDevice]
) -> tuple[ValveTurn, ...] | Finding:
    turns = []
    for position in route.valves:
        driven_by = view.device_by_node.get(position.valve_id)
        if driven_by is None or not _selects(driven_by, position.valve_id):
            name = view.tree.find(position.valve_id).name
            message = f"{name} is on the way, and no device of this lab turns it"
            return Finding("plan.no_device", message)
        turns.append(ValveTurn(driven_by, position.valve_id, position.port_index))
    for end in (route.ports[0], route.ports[-1]):
        device = pumps.get(end.resource_id)
        if device is not None and is_numbered(end.port) and _selects(device, end.resource_id):
            turns.append(ValveTurn(device, end.resource_id, int(end.port)))
    for turn in turns:
        count = setting(turn.device, "ports_count")
        if count is not None and turn.port_index > count:
            message = (
                f"{turn.device.name} has {count:g} ports; the connections name port "
                f"{turn.port_index}"
            )
            return Finding("plan.no_such_port", message)
    return tuple(turns)


def _why_not(
    view: PlannerView, source: UUID, target: UUID, reasons: list[Finding], pumps: list[UUID]
) -> Finding:
    """Say the reason that helps most: what is missing, and where."""
    other = [reason for reason in reasons if reason.code != "plan.no_route"]
    if other:
        return other[0]
    drawing = [pump for pump in pumps if _reaches(view, source, pump)]
    pushing = [pump for pump in pumps if _reaches(view, pump, target)]
    if drawing and pushing:
        return _relay(view, (source, target), drawing, pushing)
    idle = [
        node.id
        for node in view.tree.resources
        if node.kind == "syringe_pump" and node.id not in view.device_by_node
    ]
    able = [i for i in idle if _reaches(view, source, i) and _reaches(view, i, target)]
    if able:
        name = view.tree.find(able[0]).name
        message = f"{name} could do it, but no device of this lab drives it"
        return Finding("plan.no_device", message, "", {"pumps": _keys(view, able)})
    return reasons[0] if drawing or not pushing else reasons[pumps.index(pushing[0])]


def _relay(
    view: PlannerView, ends: tuple[UUID, UUID], drawing: list[UUID], pushing: list[UUID]
) -> Finding:
    """Say where a transfer that needs two pumps breaks, and which vessels both reach."""
    first, second, via = _choose_relay(view, ends, drawing, pushing)
    source, target = (view.tree.find(end).name for end in ends)
    names = view.tree.find(first).name, view.tree.find(second).name
    advice = ", ".join(view.tree.find(i).name for i in via)
    message = (
        f"no single pump reaches both {source} and {target}: {names[0]} draws from {source}, "
        f"{names[1]} pushes into {target}, and the way breaks between them. "
        + (f"Both reach {advice}" if via else "They share no vessel")
    )
    context = {"pumps": _keys(view, [first, second]), "via": _keys(view, via)}
    return Finding("plan.needs_relay", message, "", context)


def _choose_relay(
    view: PlannerView, ends: tuple[UUID, UUID], drawing: list[UUID], pushing: list[UUID]
) -> tuple[UUID, UUID, list[UUID]]:
    """Return the first two pumps that share a vessel, or else the first two."""
    vessels = [
        resource.id
        for resource in view.tree.resources
        if is_vessel(resource.kind) and resource.kind != "syringe_pump" and resource.id not in ends
    ]
    filled = {pump: [v for v in vessels if _reaches(view, pump, v)] for pump in drawing}
    for first in drawing:
        for second in pushing:
            via = [vessel for vessel in filled[first] if _reaches(view, vessel, second)]
            if via:
                return first, second, via
    return drawing[0], pushing[0], []


def _reaches(view: PlannerView, source: UUID, target: UUID) -> bool:
    try:
        find_route(view.graph, view.tree, source, target)
    except NoRouteError:
        return False
    return True


def _keys(view: PlannerView, ids: list[UUID]) -> list[str]:
    return [view.tree.find(i).key for i in ids]
