"""Air out of an empty vessel, gas in, several times.

```text
vacuum ──1│       │
          │ valve │common ── vessel
 argon ──2│       │
```
"""

from __future__ import annotations

from dataclasses import dataclass
from uuid import UUID

from labweb.domain.enrollment.device import Device
from labweb.domain.graph.routing import COMMON_PORT, is_numbered
from labweb.domain.graph.topology import Medium
from labweb.domain.resources.contents import total_nl
from labweb.domain.units import parse
from labweb.domain.workflows.passes.acting import draft_of, wait_job
from labweb.domain.workflows.passes.draft import Drafting, DraftJob, DraftStep
from labweb.domain.workflows.passes.roles import plays
from labweb.domain.workflows.protocol import Step

PRESSURE_TOLERANCE_RATIO = 0.1
_LETS_GAS_THROUGH = (Medium.GAS, Medium.VACUUM, Medium.LIQUID)
"""What a way between valve and vessel may be for: rigs evacuate by the tube that also drains."""

TURN_S, PUMP_DOWN_S, STOP_S = 2.0, 60.0, 2.0
MOST_ROUNDS = 20


@dataclass(frozen=True, slots=True)
class _GasValve:
    device: Device
    node_id: UUID
    vacuum: Device
    vacuum_port: int
    gas_port: int


def plan_evacuate_refill(step: Step, drafting: Drafting) -> DraftStep:
    """Turn to vacuum, draw down, turn to the gas; the vessel stays under the gas.

    The vessel must be empty by the record: what stands under vacuum boils, and nobody has
    stated how much of it would.
    """
    vessel, gas = UUID(step.params["vessel"]), UUID(step.params["gas"])
    rounds = step.params["rounds"]
    if not rounds.isdecimal() or not 0 < int(rounds) <= MOST_ROUNDS:
        message = f"say how often, from 1 to {MOST_ROUNDS}"
        drafting.refuse(step, "plan.bad_rounds", message, "params.rounds")
        return DraftStep(step=step)
    if total_nl(drafting.contents(vessel)):
        message = f"{drafting.name(vessel)} is not empty by then: what is in it would boil"
        drafting.refuse(step, "plan.not_empty", message, "params.vessel")
        return DraftStep(step=step)
    valve = _find_valve(drafting, vessel, gas)
    if valve is None:
        message = (
            f"no driven valve joins {drafting.name(vessel)} to a vacuum controller and to "
            f"{drafting.name(gas)}"
        )
        drafting.refuse(step, "plan.no_gas", message, "params.gas")
        return DraftStep(step=step)
    jobs: list[DraftJob | None] = []
    for place in range(1, int(rounds) + 1):
        jobs += _one_round(step, drafting, valve, f", {place} of {rounds}")
    return draft_of(step, jobs)


def _one_round(
    step: Step, drafting: Drafting, valve: _GasValve, text: str
) -> list[DraftJob | None]:
    vessel = UUID(step.params["vessel"])
    name, gas = drafting.name(vessel), drafting.name(UUID(step.params["gas"]))
    kpa = parse(step.params["pressure"], "pressure")
    low = {"pressure_kpa": kpa, "tolerance_kpa": PRESSURE_TOLERANCE_RATIO * kpa}

    def turn(port: int, to: str) -> DraftJob | None:
        return drafting.job(
            step,
            valve.device,
            "select_port",
            {"port_index": port},
            sentence=f"Join {name} to {to}{text}",
            locks=(vessel, valve.node_id),
            estimate_s=TURN_S,
        )

    def pump(action: str, args: dict[str, float], what: str, takes_s: float) -> DraftJob | None:
        locks = (vessel, valve.node_id)
        return drafting.job(
            step,
            valve.vacuum,
            action,
            args,
            sentence=f"{what} {name}{text}",
            locks=locks,
            estimate_s=takes_s,
        )

    def stand(field: str, sentence: str) -> list[DraftJob | None]:
        if field not in step.params:
            return []
        locks = (vessel, valve.node_id, *valve.vacuum.nodes.values())
        return [wait_job(step, drafting, locks, sentence=sentence + text, duration=field)]

    return [
        turn(valve.vacuum_port, "vacuum"),
        pump("evacuate_to", low, "Evacuate", PUMP_DOWN_S),
        *stand("vacuum_for", f"Keep {name} evacuated"),
        pump("stop_pump", {}, "Stop the pump of", STOP_S),
        turn(valve.gas_port, gas),
        *stand("gas_for", f"Let {gas} into {name}"),
    ]


def _find_valve(drafting: Drafting, vessel: UUID, gas: UUID) -> _GasValve | None:
    """Find the valve whose common port leads to the vessel, and its two numbered ports."""
    view = drafting.view
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
        numbered = {port: end for port, end in far.items() if is_numbered(port)}
        vacuum = [
            (int(port), view.device_by_node[end])
            for port, end in sorted(numbered.items())
            if end in view.device_by_node and plays(view.device_by_node[end], "vacuum_controller")
        ]
        gases = [int(port) for port, end in sorted(numbered.items()) if end == gas]
        if far.get(common) == vessel and vacuum and gases:
            return _GasValve(device, node, vacuum[0][1], vacuum[0][0], gases[0])
    return None
