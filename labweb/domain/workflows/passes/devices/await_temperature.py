"""A vessel becomes warm or cold by itself, and the run waits for it."""

from __future__ import annotations

from uuid import UUID

from labweb.domain.crutd.operations import Read
from labweb.domain.crutd.pre_and_postconditions import Condition
from labweb.domain.units import parse
from labweb.domain.workflows.passes.devices.heat_stir_wait_measure import (
    RAMP_C_S,
    ROOM_C,
    draft_of,
    find_heater,
    free_timer,
)
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftStep
from labweb.domain.workflows.passes.role_requirements import acting_node
from labweb.domain.workflows.workflow_file import Step

MOST_S = 24 * 3600.0
"""After that long without the temperature the step fails, and a person is asked."""


def plan_await_temperature(step: Step, drafting: Drafting) -> DraftStep:
    """Wait until the device that a vessel stands on reads a temperature within its limits.

    It sets nothing. A timer ends the step as soon as the reading is there; an abort and a stop of
    the lab end it at once.
    """
    vessel = UUID(step.params["vessel"])
    heater = find_heater(step, drafting, vessel)
    timer = free_timer(step, drafting, "")
    said = [step.params.get(name) for name in ("lowest", "highest")]
    low, high = (None if one is None else parse(one, "temperature") for one in said)
    if low is None and high is None:
        message = "say how warm it has to be at least, or at most, or both"
        drafting.refuse(step, "plan.no_limit", message, "params.lowest")
        return DraftStep(step=step)
    if low is not None and high is not None and low > high:
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
        sentence=f"Wait until {name} is {_told(low, high)}",
        post=(reached,),
        locks=(vessel, *heater.nodes.values()),
        estimate_s=max(abs(one - ROOM_C) for one in (low, high) if one is not None) / RAMP_C_S,
    )
    return draft_of(step, [job])


def _told(low: float | None, high: float | None) -> str:
    if low is None:
        return f"at {high:g} °C or below"
    return f"at {low:g} °C or above" if high is None else f"between {low:g} and {high:g} °C"
