"""Solvents boil off a rotating flask and condense in another.

```text
flask: ether, product ──▶ vapour ──▶ condenser ──▶ receiver: ether
```
"""

from __future__ import annotations

from collections.abc import Mapping
from uuid import UUID

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.resources.contents_by_lot import LotId, total_nl
from labweb.domain.units import parse
from labweb.domain.workflows.passes.chemistry.phase_separation import meant_lots
from labweb.domain.workflows.passes.chemistry.vacuum_source import find_vacuum
from labweb.domain.workflows.passes.devices.device_of_vessel import condenses, find_carrier
from labweb.domain.workflows.passes.devices.heat_stir_wait_measure import draft_of, ramp_s, wait_job
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftJob, DraftStep
from labweb.domain.workflows.passes.people.stated_at_run import ask_to_state
from labweb.domain.workflows.workflow_file import Step

BATH_TOLERANCE_C = 2.0
"""How near the bath must be before the vacuum is drawn."""

PRESSURE_TOLERANCE_RATIO = 0.1
"""How near the pressure must be before the time counts, of the pressure that is asked for."""

LIFT_S, PUMP_DOWN_S, VENT_S, SWITCH_S = 10.0, 60.0, 20.0, 2.0


def condensed(
    drafting: Drafting, vessel: UUID, receiver: UUID, gone: Mapping[LotId, int]
) -> TransferLiquid:
    """Return what goes from one vessel into another as vapour: no solid goes with it."""
    return TransferLiquid(
        source_id=vessel,
        target_id=receiver,
        amount_nl=total_nl(gone),
        parts_nl={str(lot): part for lot, part in gone.items()},
        keeps=tuple(UUID(lot) for lot in sorted(drafting.solids(vessel))),
    )


def plan_evaporate(step: Step, drafting: Drafting) -> DraftStep:
    """Warm, turn, evacuate, wait, and let air in again.

    What boils off is stated, before the run or during it. The end of the wait writes down what
    went into the receiver. Broken off, nobody knows how much that was, and both flasks are
    quarantined.
    """
    params = step.params
    vessel, receiver = UUID(params["vessel"]), UUID(params["receiver"])
    evaporator = find_carrier(step, drafting, vessel, "rotary_evaporator")
    vacuum = find_vacuum(step, drafting, vessel)
    later, gone = meant_lots(step, drafting, vessel, "boils_off")
    if evaporator is None or vacuum is None or gone is None:
        return DraftStep(step=step)
    if not condenses(drafting, vessel, receiver):
        message = f"no way for vapour leads from {drafting.name(vessel)} into it"
        drafting.refuse(step, "plan.no_condenser", message, "params.receiver")
        return DraftStep(step=step)
    target_c = parse(params["temperature"], "temperature")
    kpa, rpm = parse(params["pressure"], "pressure"), parse(params["speed"], "speed")
    bath = {"temperature_c": target_c, "tolerance_c": BATH_TOLERANCE_C}
    low = {"pressure_kpa": kpa, "tolerance_kpa": PRESSURE_TOLERANCE_RATIO * kpa}
    name = drafting.name(vessel)
    held = vacuum.nodes if vacuum.valve is not None else ()

    def one(
        device: AdmittedDevice, action: str, args: dict[str, float], text: str, takes_s: float
    ) -> DraftJob | None:
        return drafting.job(
            step, device, action, args, sentence=text, locks=(vessel, *held), estimate_s=takes_s
        )

    warm_s = ramp_s(drafting, evaporator, vessel, target_c)
    jobs = [
        one(evaporator, "heat_bath_to", bath, f"Bring the bath to {target_c:g} °C", warm_s),
        one(evaporator, "rotate", {"speed_rpm": rpm}, f"Turn {name} at {rpm:g} rpm", SWITCH_S),
        one(evaporator, "lower_flask", {}, f"Lower {name} into the bath", LIFT_S),
        *vacuum.join(step, drafting, vessel),
        one(vacuum.device, "evacuate_to", low, f"Evacuate {name} to {kpa:g} kPa", PUMP_DOWN_S),
        wait_job(
            step,
            drafting,
            (vessel, receiver, *evaporator.nodes.values(), *vacuum.nodes),
            sentence=f"Let {name} boil down",
            operation=condensed(drafting, vessel, receiver, gone),
        ),
        one(vacuum.device, "vent", {}, f"Let air into {name}", VENT_S),
        one(evaporator, "raise_flask", {}, f"Raise {name}", LIFT_S),
        one(evaporator, "stop_rotating", {}, f"Stop turning {name}", SWITCH_S),
        one(evaporator, "stop_heating", {}, "Stop heating the bath", SWITCH_S),
    ]
    if later:
        question = f"What of each lot in {name} will boil off?"
        jobs = [ask_to_state(step, drafting, vessel, later, question), *jobs]
    return draft_of(step, jobs)
