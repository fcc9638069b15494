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

from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.resources.contents_by_lot import total_nl
from labweb.domain.units import parse
from labweb.domain.workflows.passes.chemistry.vacuum_source import (
    GasValve,
    gas_valves,
    vacuum_ports,
)
from labweb.domain.workflows.passes.devices.heat_stir_wait_measure import draft_of, wait_job
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftJob, DraftStep
from labweb.domain.workflows.workflow_file import Step

PRESSURE_TOLERANCE_RATIO = 0.1
PUMP_DOWN_S, STOP_S = 60.0, 2.0
MOST_ROUNDS = 20


@dataclass(frozen=True, slots=True)
class _Ports:
    valve: GasValve
    vacuum: AdmittedDevice
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


def _one_round(step: Step, drafting: Drafting, valve: _Ports, text: str) -> list[DraftJob | None]:
    vessel = UUID(step.params["vessel"])
    name, gas = drafting.name(vessel), drafting.name(UUID(step.params["gas"]))
    kpa = parse(step.params["pressure"], "pressure")
    low = {"pressure_kpa": kpa, "tolerance_kpa": PRESSURE_TOLERANCE_RATIO * kpa}

    def turn(port: int, to: str) -> DraftJob | None:
        return valve.valve.turn(step, drafting, vessel, port, f"Join {name} to {to}{text}")

    def pump(action: str, args: dict[str, float], what: str, takes_s: float) -> DraftJob | None:
        locks = (vessel, valve.valve.node_id)
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
        locks = (vessel, valve.valve.node_id, *valve.vacuum.nodes.values())
        return [wait_job(step, drafting, locks, sentence=sentence + text, duration=field)]

    return [
        turn(valve.vacuum_port, "vacuum"),
        pump("evacuate_to", low, "Evacuate", PUMP_DOWN_S),
        *stand("vacuum_for", f"Keep {name} evacuated"),
        pump("stop_pump", {}, "Stop the pump of", STOP_S),
        turn(valve.gas_port, gas),
        *stand("gas_for", f"Let {gas} into {name}"),
    ]


def _find_valve(drafting: Drafting, vessel: UUID, gas: UUID) -> _Ports | None:
    """Find the valve whose common port leads to the vessel, and its two numbered ports."""
    for valve in gas_valves(drafting.view, vessel):
        vacuum = next(vacuum_ports(drafting.view, valve), None)
        gases = [port for port, end in valve.ends.items() if end == gas]
        if vacuum is not None and gases:
            return _Ports(valve, vacuum[1], vacuum[0], gases[0])
    return None
