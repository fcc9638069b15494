"""A vessel becomes warm or cold by itself, and the run waits for it."""

from __future__ import annotations

from uuid import UUID

from labweb.domain.crutd.conditions import Condition
from labweb.domain.crutd.operations import Read
from labweb.domain.units import parse
from labweb.domain.workflows.passes.acting import (
    RAMP_C_S,
    ROOM_C,
    draft_of,
    find_heater,
    free_timer,
)
from labweb.domain.workflows.passes.draft import Drafting, DraftStep
from labweb.domain.workflows.passes.roles import acting_node
from labweb.domain.workflows.protocol import Step

MOST_S = 24 * 3600.0
"""After that long without the temperature the step fails, and a person is asked."""


def plan_await_temperature(step: Step, drafting: Drafting) -> DraftStep:
    """Wait until the device that a vessel stands on reads a temperature between two limits.

    It sets nothing. A timer ends the step as soon as the reading is there; an abort and a stop of
    the lab end it at once.
    """
    vessel = UUID(step.params["vessel"])
    heater = find_heater(step, drafting, vessel)
    timer = free_timer(step, drafting, "")
    low, high = (parse(step.params[name], "temperature") for name in ("lowest", "highest"))
    if low > high:
        message = f"at least {low:g} °C is more than at most {high:g} °C"
        drafting.refuse(step, "plan.out_of_range", message, "params.lowest", low=low, high=high)
        return DraftStep(step=step)
    if heater is None or timer is None:
        return DraftStep(step=step)
    name = drafting.name(vessel)
    reached = Condition(
        name="vessel.between_temperatures",
        device_id=heater.id,
        status="temperature_c",
        low=low,
        high=high,
        timeout_s=MOST_S,
        is_sensor=True,
    )
    node = acting_node(timer, "wait")
    if node is None:
        drafting.refuse(step, "plan.no_node", f"{timer.name} is no resource of this lab", "")
        return DraftStep(step=step)
    job = drafting.job(
        step,
        timer,
        "wait",
        {"duration_s": 0.0},
        # It only reads: what is given up while it waits leaves nothing in doubt.
        operation=Read(device_id=node),
        sentence=f"Wait until {name} is between {low:g} and {high:g} °C",
        post=(reached,),
        locks=(vessel, *heater.nodes.values()),
        estimate_s=abs((low + high) / 2 - ROOM_C) / RAMP_C_S,
    )
    return draft_of(step, [job])
