"""A vessel stands under vacuum for a time: what is wet in it dries.

```text
filter: salt, ether ──▶ vapour ──▶ trap: ether
```
"""

from __future__ import annotations

from collections.abc import Mapping
from uuid import UUID

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.resources.contents_by_lot import total_nl
from labweb.domain.units import parse, render_volume
from labweb.domain.workflows.passes.chemistry.evaporation import (
    PRESSURE_TOLERANCE_RATIO,
    PUMP_DOWN_S,
    VENT_S,
    condensed,
)
from labweb.domain.workflows.passes.chemistry.phase_separation import stated_lots
from labweb.domain.workflows.passes.chemistry.vacuum_source import VacuumSource, find_vacuum
from labweb.domain.workflows.passes.devices.device_of_vessel import condenses
from labweb.domain.workflows.passes.devices.heat_stir_wait_measure import draft_of, wait_job
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftJob, DraftStep
from labweb.domain.workflows.workflow_file import Step

_OFF = "dries_off"


def plan_dry(step: Step, drafting: Drafting) -> DraftStep:
    """Evacuate, wait, and let air in again; what dries off is stated, and where it condenses.

    A vessel that by the record holds no liquid by then needs no statement. The end of the wait
    writes down what went into the receiver; broken off, nobody knows how much that was, and both
    vessels are quarantined.
    """
    vessel = UUID(step.params["vessel"])
    vacuum = find_vacuum(step, drafting, vessel)
    if not _is_stated(step, drafting, vessel):
        return DraftStep(step=step)
    dried = _dried(step, drafting, vessel) if step.params.get(_OFF) else None
    if vacuum is None or (dried is None and step.params.get(_OFF)):
        return DraftStep(step=step)
    name, kpa = drafting.name(vessel), parse(step.params["pressure"], "pressure")
    low = {"pressure_kpa": kpa, "tolerance_kpa": PRESSURE_TOLERANCE_RATIO * kpa}
    locks = (vessel, *vacuum.nodes, *(() if dried is None else (dried.target_id,)))
    text = f"Keep {name} under vacuum"
    jobs = [
        *vacuum.join(step, drafting, vessel),
        _one(step, drafting, vacuum, "evacuate_to", low, f"Evacuate {name} to {kpa:g} kPa"),
        wait_job(step, drafting, locks, sentence=text, operation=dried),
        _one(step, drafting, vacuum, "vent", {}, f"Let air into {name}"),
    ]
    return draft_of(step, jobs)


def _one(
    step: Step,
    drafting: Drafting,
    vacuum: VacuumSource,
    action: str,
    args: Mapping[str, float],
    text: str,
) -> DraftJob | None:
    takes_s = PUMP_DOWN_S if action == "evacuate_to" else VENT_S
    locks = (UUID(step.params["vessel"]), *vacuum.nodes)
    return drafting.job(
        step, vacuum.device, action, args, sentence=text, locks=locks, estimate_s=takes_s
    )


def _is_stated(step: Step, drafting: Drafting, vessel: UUID) -> bool:
    """Tell whether a step says of what is wet how much dries off, and to where."""
    is_wet = bool(step.params.get(_OFF))
    if is_wet != ("receiver" in step.params):
        missing = "receiver" if is_wet else _OFF
        message = "say both what dries off and which vessel it condenses in, or neither"
        drafting.refuse(step, "plan.no_condenser", message, f"params.{missing}")
        return False
    held_nl = total_nl(drafting.contents(vessel))
    if held_nl and not is_wet:
        message = (
            f"{drafting.name(vessel)} holds {render_volume(held_nl)} by then, which would boil: "
            "say what of it dries off, and which vessel it condenses in"
        )
        drafting.refuse(step, "plan.not_empty", message, f"params.{_OFF}")
        return False
    return True


def _dried(step: Step, drafting: Drafting, vessel: UUID) -> TransferLiquid | None:
    receiver = UUID(step.params["receiver"])
    gone = stated_lots(step, drafting, vessel, _OFF)
    if not condenses(drafting, vessel, receiver):
        message = f"no way for vapour leads from {drafting.name(vessel)} into it"
        drafting.refuse(step, "plan.no_condenser", message, "params.receiver")
        return None
    return None if gone is None else condensed(drafting, vessel, receiver, gone)
