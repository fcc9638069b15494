"""Heating, stirring, waiting, measuring, and whatever else one device does by itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from uuid import UUID

from labweb.domain.calibration.correction import CalibrationQuantity
from labweb.domain.crutd.operations import Operation
from labweb.domain.crutd.pre_and_postconditions import Condition
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.errors import NotFoundError
from labweb.domain.units import parse
from labweb.domain.workflows.passes.devices.calibration_correction import ACCURACIES
from labweb.domain.workflows.passes.devices.deck_pipetting import deck_job, moves_between_wells
from labweb.domain.workflows.passes.devices.device_of_vessel import (
    carriers,
    find_carrier,
    is_accurate,
)
from labweb.domain.workflows.passes.devices.sampling import INJECTION, injection_job, sample_in
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftJob, DraftStep
from labweb.domain.workflows.passes.role_requirements import (
    HEAT_TOLERANCE_C,
    HOLD_TOLERANCE_C,
    plays,
    post_conditions,
    setting,
)
from labweb.domain.workflows.workflow_file import Step

RAMP_C_S = 0.1
"""Estimate for heating and cooling, unless the device's settings have `ramp_c_s`."""

ROOM_C = 20.0
"""Estimate of a temperature that nobody has read yet."""

STIR_S = 3.0
READ_S = 5.0
_HEATED = (("heater", "stop_heating"), ("thermostat", "stop_control"))
_SWITCHED = (*_HEATED, ("stirrer", "stop_stirring"))
SWITCH_S = 2.0


def plan_heat_chill(step: Step, drafting: Drafting) -> DraftStep:
    """Stir if asked, reach the temperature, and with a hold keep it and switch off."""
    vessel = UUID(step.params["vessel"])
    heater = find_heater(step, drafting, vessel)
    wants_stir = "stir_speed" in step.params
    stirrer = find_carrier(step, drafting, vessel, "stirrer") if wants_stir else None
    if heater is None or (wants_stir and stirrer is None):
        return DraftStep(step=step)
    name = drafting.name(vessel)
    target_c = parse(step.params["temperature"], "temperature")
    jobs: list[DraftJob | None] = []
    if not is_accurate(step, drafting, heater, CalibrationQuantity.TEMPERATURE, target_c):
        jobs.append(None)
    if stirrer is not None:
        jobs.append(_stir(step, drafting, stirrer, vessel))
    jobs.append(
        drafting.job(
            step,
            heater,
            "heat_to" if plays(heater, "heater") else "reach_temperature",
            {"temperature_c": target_c, "tolerance_c": _reached_c(step)},
            sentence=f"Bring {name} to {target_c:g} °C",
            locks=(vessel,),
            estimate_s=ramp_s(drafting, heater, vessel, target_c),
        )
    )
    if "hold_for" in step.params:
        jobs += _hold(step, drafting, heater, stirrer, target_c)
    return draft_of(step, jobs)


def _hold(
    step: Step,
    drafting: Drafting,
    heater: AdmittedDevice,
    stirrer: AdmittedDevice | None,
    target_c: float,
) -> list[DraftJob | None]:
    vessel = UUID(step.params["vessel"])
    name = drafting.name(vessel)
    hold_s = parse(step.params["hold_for"], "time")
    tolerance_c = _tolerance_c(step, HOLD_TOLERANCE_C)
    args = {"duration_s": hold_s, "temperature_c": target_c, "tolerance_c": tolerance_c}
    text = f"Hold {name} at {target_c:g} °C for {hold_s:g} s"
    if plays(heater, "heater"):
        held = drafting.job(
            step, heater, "hold", args, sentence=text, locks=(vessel,), estimate_s=hold_s
        )
    else:
        others = () if stirrer is None else tuple(stirrer.nodes.values())
        locks = (vessel, *heater.nodes.values(), *others)
        post = post_conditions(heater, "hold", args)
        held = wait_job(step, drafting, locks, sentence=text, duration="hold_for", post=post)
    jobs = [
        held,
        _stop(step, drafting, heater, _off(heater), vessel),
    ]
    if stirrer is not None:
        jobs.append(_stop(step, drafting, stirrer, "stop_stirring", vessel))
    return jobs


def _tolerance_c(step: Step, usual_c: float) -> float:
    """Return how far the reading may be from the set point: never more than a step allows."""
    if "accuracy" not in step.params:
        return usual_c
    return min(usual_c, parse(step.params["accuracy"], ACCURACIES[CalibrationQuantity.TEMPERATURE]))


def _reached_c(step: Step) -> float:
    """Return how near the reading has to come before the set point counts as reached."""
    if "tolerance" not in step.params:
        return _tolerance_c(step, HEAT_TOLERANCE_C)
    return _tolerance_c(step, parse(step.params["tolerance"], "temperature_difference"))


def _off(heater: AdmittedDevice) -> str:
    return "stop_heating" if plays(heater, "heater") else "stop_control"


def find_heater(step: Step, drafting: Drafting, vessel: UUID) -> AdmittedDevice | None:
    """Return the hotplate or the thermostat of a vessel; note when it is not one."""
    role = "thermostat" if carriers(drafting, vessel, "thermostat") else "heater"
    return find_carrier(step, drafting, vessel, role)


def plan_start_stir(step: Step, drafting: Drafting) -> DraftStep:
    """Stir from now on; a later step stops it."""
    vessel = UUID(step.params["vessel"])
    stirrer = find_carrier(step, drafting, vessel, "stirrer")
    if stirrer is None:
        return DraftStep(step=step)
    return draft_of(step, [_stir(step, drafting, stirrer, vessel)])


def plan_stop_stir(step: Step, drafting: Drafting) -> DraftStep:
    """Stop stirring, and leave the heater as it is."""
    vessel = UUID(step.params["vessel"])
    stirrer = find_carrier(step, drafting, vessel, "stirrer")
    if stirrer is None:
        return DraftStep(step=step)
    return draft_of(step, [_stop(step, drafting, stirrer, "stop_stirring", vessel)])


def plan_stir(step: Step, drafting: Drafting) -> DraftStep:
    """Stir for a time counted by a timer, then stop."""
    vessel = UUID(step.params["vessel"])
    stirrer = find_carrier(step, drafting, vessel, "stirrer")
    if stirrer is None:
        return DraftStep(step=step)
    jobs = [
        _stir(step, drafting, stirrer, vessel),
        wait_job(step, drafting, (vessel, *stirrer.nodes.values())),
        _stop(step, drafting, stirrer, "stop_stirring", vessel),
    ]
    return draft_of(step, jobs)


def plan_stop(step: Step, drafting: Drafting) -> DraftStep:
    """Switch off the heater and the stirrer that a vessel stands on, whichever there are."""
    return _switch_off(step, drafting, _SWITCHED, "heats or stirs")


def plan_stop_heat(step: Step, drafting: Drafting) -> DraftStep:
    """Switch off what heats or chills a vessel, and leave the stirrer as it is."""
    return _switch_off(step, drafting, _HEATED, "heats or chills")


def _switch_off(
    step: Step, drafting: Drafting, roles: tuple[tuple[str, str], ...], what: str
) -> DraftStep:
    vessel = UUID(step.params["vessel"])
    jobs: list[DraftJob | None] = []
    for role, action in roles:
        found = carriers(drafting, vessel, role)
        jobs += [_stop(step, drafting, device, action, vessel) for device in found]
    if not jobs:
        message = f"{drafting.name(vessel)} stands on nothing that {what}"
        drafting.refuse(step, "plan.no_device", message, "params.vessel")
    return draft_of(step, jobs)


def plan_wait(step: Step, drafting: Drafting) -> DraftStep:
    """Wait on a timer of the lab."""
    return draft_of(step, [wait_job(step, drafting, ())])


def plan_weigh(step: Step, drafting: Drafting) -> DraftStep:
    """Read a balance."""
    return _plan_reading(step, drafting, "balance", "balance", "weigh", "Weigh on")


def plan_measure_ph(step: Step, drafting: Drafting) -> DraftStep:
    """Read a pH transmitter."""
    return _plan_reading(step, drafting, "transmitter", "ph", "measure", "Measure pH with")


def plan_device_action(step: Step, drafting: Drafting) -> DraftStep:
    """Call one action as the driver declares it; what moves liquid must be a Transfer."""
    device = drafting.view.find_device(UUID(step.params["device"]))
    if device is None:
        message = "nothing drives that resource in this lab"
        drafting.refuse(step, "plan.no_device", message, "params.device")
        return DraftStep(step=step)
    name = step.params["action"]
    try:
        action = device.spec.action(name)
    except NotFoundError as error:
        drafting.refuse(step, error.code, error.message, "params.action", **error.context)
        return DraftStep(step=step)
    if INJECTION in {one.name for one in action.parameters}:
        return draft_of(step, [injection_job(step, drafting, device, READ_S)])
    if moves_between_wells(device, name):
        return draft_of(step, [deck_job(step, drafting, device)])
    if action.operation == "transfer" and name != "initialize":
        message = f"{name} of {device.name} moves liquid: use a Transfer, which keeps the record"
        drafting.refuse(step, "plan.moves_liquid", message, "params.action")
        return DraftStep(step=step)
    sample = sample_in(step, drafting, device, action)
    if sample is None:
        return DraftStep(step=step)
    job = drafting.job(
        step,
        device,
        name,
        step.params.get("args", {}),
        sentence=f"{device.name}: {name.replace('_', ' ')}",
        sample_id=sample.resource_id,
        locks=drafting.view.vessels_on(device) | drafting.view.cells_of(device),
        estimate_s=min(action.timeout_s or READ_S, READ_S),
    )
    return draft_of(step, [job])


def draft_of(step: Step, jobs: list[DraftJob | None]) -> DraftStep:
    """Keep the jobs of a step only when every one of them could be planned."""
    made = tuple(job for job in jobs if job is not None)
    return DraftStep(step=step, jobs=made if len(made) == len(jobs) else ())


def _stir(step: Step, drafting: Drafting, stirrer: AdmittedDevice, vessel: UUID) -> DraftJob | None:
    speed_rpm = parse(step.params["stir_speed"], "speed")
    return drafting.job(
        step,
        stirrer,
        "stir",
        {"speed_rpm": speed_rpm},
        sentence=f"Stir {drafting.name(vessel)} at {speed_rpm:g} rpm",
        locks=(vessel,),
        estimate_s=STIR_S,
    )


def _stop(
    step: Step, drafting: Drafting, device: AdmittedDevice, action: str, vessel: UUID
) -> DraftJob | None:
    what = "stirring" if action == "stop_stirring" else "heating"
    return drafting.job(
        step,
        device,
        action,
        {},
        sentence=f"Stop {what} {drafting.name(vessel)}",
        locks=(vessel,),
        estimate_s=SWITCH_S,
    )


def wait_job(  # noqa: PLR0913 - as for any job; all but three are keywords
    step: Step,
    drafting: Drafting,
    locks: tuple[UUID, ...],
    *,
    sentence: str = "",
    operation: Operation | None = None,
    duration: str = "duration",
    post: tuple[Condition, ...] = (),
) -> DraftJob | None:
    """Make a job that waits on a timer, for what the operation says happens meanwhile.

    `duration` is the field of the step that says how long.
    """
    timer = free_timer(step, drafting, f"params.{duration}")
    if timer is None:
        return None
    duration_s = parse(step.params[duration], "time")
    return drafting.job(
        step,
        timer,
        "wait",
        {"duration_s": duration_s},
        sentence=sentence or f"Wait {duration_s:g} s",
        operation=operation,
        post=post,
        locks=locks,
        estimate_s=duration_s,
    )


def free_timer(step: Step, drafting: Drafting, at: str) -> AdmittedDevice | None:
    """Return the first timer no step uses that may run at the same time, else the first.

    A finding is noted in a lab that has none.
    """
    timers = [device for device in drafting.view.devices_by_key if plays(device, "timer")]
    if not timers:
        message = "no device of this lab is a timer"
        drafting.refuse(step, "plan.no_device", message, at, role="timer")
        return None
    earlier = drafting.earlier[step.id]
    users = drafting.timer_users
    free = (t for t in timers if earlier.issuperset(users.get(t.id, ())))
    timer = next(free, timers[0])
    users.setdefault(timer.id, []).append(step.id)
    return timer


def _plan_reading(
    step: Step, drafting: Drafting, field: str, role: str, action: str, verb: str
) -> DraftStep:
    device = drafting.view.find_device(UUID(step.params[field]))
    if device is None or not plays(device, role):
        message = "no device of this lab reads that instrument"
        drafting.refuse(step, "plan.no_device", message, f"params.{field}", role=role)
        return DraftStep(step=step)
    if not is_accurate(step, drafting, device, CalibrationQuantity.PH):
        return DraftStep(step=step)
    job = drafting.job(
        step,
        device,
        action,
        {},
        sentence=f"{verb} {device.name}",
        locks=drafting.view.vessels_on(device),
        estimate_s=READ_S,
    )
    return draft_of(step, [job])


def ramp_s(drafting: Drafting, heater: AdmittedDevice, vessel: UUID, target_c: float) -> float:
    """Estimate the time to a temperature: difference over ramp."""
    known = [drafting.view.state(i) for i in (vessel, *heater.nodes.values())]
    told = [state.data.get("temperature_c") for state in known if state is not None]
    now_c = next((float(t) for t in told if isinstance(t, int | float)), ROOM_C)
    return abs(target_c - now_c) / (setting(heater, "ramp_c_s") or RAMP_C_S)


PLANNERS: Mapping[str, Callable[[Step, Drafting], DraftStep]] = {
    "heat_chill": plan_heat_chill,
    "start_stir": plan_start_stir,
    "stir": plan_stir,
    "stop_stir": plan_stop_stir,
    "stop_heat": plan_stop_heat,
    "stop_heat_stir": plan_stop,
    "wait": plan_wait,
    "weigh": plan_weigh,
    "measure_ph": plan_measure_ph,
    "device_action": plan_device_action,
}
"""Planner by kind of step."""
