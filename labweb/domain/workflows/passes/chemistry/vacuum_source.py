"""What draws the air out of a vessel: a controller that is joined to it, or one behind a valve.

```text
vacuum ── vessel          vacuum ──1│       │
                                    │ valve │common ── vessel
                           argon ──2│       │
```
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from uuid import UUID

from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.graph.routing import COMMON_PORT, is_numbered
from labweb.domain.resources.resource_kinds import VACUUMS
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftJob
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.passes.role_requirements import plays
from labweb.domain.workflows.workflow_file import Step

_LETS_GAS_THROUGH = (Medium.GAS, Medium.VACUUM, Medium.LIQUID)
"""What a way between valve and vessel may be for: rigs evacuate by the tube that also drains."""

_CONTROLLER = "vacuum_controller"
TURN_S = 2.0


@dataclass(frozen=True, slots=True)
class GasValve:
    """A driven valve whose common port leads to a vessel."""

    device: AdmittedDevice
    node_id: UUID
    ends: Mapping[int, UUID]
    """Port → what is behind it."""

    def turn(
        self, step: Step, drafting: Drafting, vessel: UUID, port: int, sentence: str
    ) -> DraftJob | None:
        """Make the job that joins the vessel to what is behind a port."""
        return drafting.job(
            step,
            self.device,
            "select_port",
            {"port_index": port},
            sentence=sentence,
            locks=(vessel, self.node_id),
            estimate_s=TURN_S,
        )


@dataclass(frozen=True, slots=True)
class VacuumSource:
    """A controller, and the valve that has to join it to the vessel; None: it always is."""

    device: AdmittedDevice
    valve: GasValve | None = None
    port: int = 0

    def join(self, step: Step, drafting: Drafting, vessel: UUID) -> list[DraftJob | None]:
        """Make the job that joins it to the vessel; none where it always is."""
        if self.valve is None:
            return []
        sentence = f"Join {drafting.name(vessel)} to vacuum"
        return [self.valve.turn(step, drafting, vessel, self.port, sentence)]

    @property
    def nodes(self) -> tuple[UUID, ...]:
        """Return the resources that are in use while it draws."""
        own = tuple(self.device.nodes.values())
        return own if self.valve is None else (*own, self.valve.node_id)


def find_vacuum(step: Step, drafting: Drafting, vessel: UUID) -> VacuumSource | None:
    """Return the one vacuum that can be drawn on a vessel; note when it is not one."""
    view = drafting.view
    found = [VacuumSource(device) for device in _joined(view, vessel)]
    if not found:
        found = [
            VacuumSource(device, valve, port)
            for valve in gas_valves(view, vessel)
            for port, device in vacuum_ports(view, valve)
        ]
    if len(found) == 1:
        return found[0]
    code = "plan.ambiguous_device" if found else "plan.no_device"
    message = (
        f"{len(found)} vacuum controllers are joined to {drafting.name(vessel)}, by a tube or "
        "by a valve that a device of this lab turns; one is needed"
    )
    drafting.refuse(step, code, message, "params.vessel", role=_CONTROLLER)
    return None


def gas_valves(view: PlannerView, vessel: UUID) -> Iterator[GasValve]:
    """Yield the driven valves whose common port leads to a vessel."""
    for node, device in sorted(view.device_by_node.items()):
        resource = view.tree.by_id.get(node)
        if resource is None or resource.kind != "rotary_valve" or not plays(device, "valve"):
            continue
        common = str(resource.config.get("common_port", COMMON_PORT))
        far: dict[str, UUID] = {}
        for way in view.graph.by_resource.get(node, ()):
            if way.medium in _LETS_GAS_THROUGH:
                ends = (way.source, way.target)
                own, other = ends if ends[0].resource_id == node else ends[::-1]
                far[own.port] = other.resource_id
        if far.get(common) == vessel:
            ports = {int(port): end for port, end in far.items() if is_numbered(port)}
            yield GasValve(device, node, dict(sorted(ports.items())))


def vacuum_ports(view: PlannerView, valve: GasValve) -> Iterator[tuple[int, AdmittedDevice]]:
    """Yield the ports of a valve behind which a controller draws, by a line of its own or not."""
    for port, end in valve.ends.items():
        device = view.device_by_node.get(end)
        if device is not None and plays(device, _CONTROLLER):
            yield port, device
        elif view.tree.find(end).kind in VACUUMS:  # a line was a controller in labs of before
            yield from ((port, behind) for behind in _joined(view, end))


def _joined(view: PlannerView, node: UUID) -> list[AdmittedDevice]:
    """Return the controllers that a tube for vacuum joins to a resource."""
    ends = (
        end.resource_id
        for way in view.graph.by_resource.get(node, ())
        if way.medium is Medium.VACUUM
        for end in (way.source, way.target)
        if end.resource_id != node
    )
    devices = (view.device_by_node.get(end) for end in ends)
    return [one for one in devices if one is not None and plays(one, _CONTROLLER)]
