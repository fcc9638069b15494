"""What calibrations do to a plan: who may act, and which numbers a device is given.

The one place where a number of a command is corrected. It stands behind everything else that
plans, so that the rest of the planner, the ledger and the page speak of true values alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import msgspec

from labweb.domain.calibration.calibration_result import as_text
from labweb.domain.calibration.correction import (
    DIGITS,
    IS_RELATIVE,
    SYMBOLS,
    AcceptedCalibration,
    CalibrationQuantity,
    CalibrationStanding,
    Correction,
    correction_of,
)
from labweb.domain.crutd.operations import Read
from labweb.domain.crutd.pre_and_postconditions import Condition
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.enrollment.driver_spec import ParameterSpec, check_arguments
from labweb.domain.errors import Finding
from labweb.domain.units import parse
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftJob, DraftStep
from labweb.domain.workflows.passes.role_requirements import beyond_limits, setting
from labweb.domain.workflows.unit_operations.step_palette import STEP_KINDS
from labweb.domain.workflows.workflow_file import Step

ACCURACIES: Mapping[CalibrationQuantity, str] = {
    CalibrationQuantity.VOLUME: "share",
    CalibrationQuantity.PH: "ph_difference",
    CalibrationQuantity.TEMPERATURE: "temperature_difference",
}
"""How a step's accuracy is written, by the quantity that it is of."""


def calibration_of(
    device: AdmittedDevice, quantity: CalibrationQuantity
) -> AcceptedCalibration | None:
    """Return the newest calibration of a quantity, whether it is in force or not."""
    return next((one for one in device.calibrations if one.quantity is quantity), None)


def in_force(device: AdmittedDevice, quantity: CalibrationQuantity) -> AcceptedCalibration | None:
    """Return the calibration that corrects a quantity now; None: nothing does."""
    found = calibration_of(device, quantity)
    return found if found is not None and found.is_in_force else None


def check_accuracy(
    device: AdmittedDevice, quantity: CalibrationQuantity, values: Iterable[float], wanted: float
) -> list[Finding]:
    """List why a device is not known to be as accurate as a step needs; empty means it is.

    Args:
        device: The device.
        quantity: Of what.
        values: True values that it has to make or tell.
        wanted: Largest expanded uncertainty (k = 2): of a volume a share, else in its unit.
    """
    found, needs = calibration_of(device, quantity), as_text(quantity, wanted)
    if found is None:
        text = (
            f"{device.name} has no calibration of {quantity.value}, and the step needs {needs}"
            f"{_makers_word(device, quantity)}: calibrate it on its page"
        )
        return [Finding("calibration.missing", text)]
    if not found.is_in_force:
        why = "; ".join(found.reasons)
        text = (
            f"calibration {found.number} of {quantity.value} of {device.name} does not hold: "
            f"{why}. The step needs {needs}: calibrate it again"
        )
        is_gone, is_due = (
            found.standing is one
            for one in (CalibrationStanding.WITHDRAWN, CalibrationStanding.EXPIRED)
        )
        return [
            Finding(
                "calibration.withdrawn"
                if is_gone
                else "calibration.expired"
                if is_due
                else "calibration.changed",
                text,
            )
        ]
    return [finding for value in values for finding in _check_value(device, found, value, wanted)]


def _check_value(
    device: AdmittedDevice, found: AcceptedCalibration, value: float, wanted: float
) -> Iterator[Finding]:
    quantity, symbol = found.quantity, SYMBOLS[found.quantity]
    expanded = found.expanded_at(value)
    if expanded is None:
        low, high = found.levels[0].value, found.levels[-1].value
        text = (
            f"{device.name} was calibrated from {low:.5g} to {high:.5g} {symbol}; of {value:.5g} "
            f"{symbol} nothing is known, and the step needs {as_text(quantity, wanted)}"
        )
        yield Finding("calibration.out_of_range", text)
        return
    reached = expanded / value if IS_RELATIVE[quantity] else expanded
    if reached > wanted:
        text = (
            f"{device.name} is calibrated to {as_text(quantity, reached)} at {value:.5g} {symbol}; "
            f"the step needs {as_text(quantity, wanted)}"
        )
        yield Finding("calibration.too_uncertain", text)


def _makers_word(device: AdmittedDevice, quantity: CalibrationQuantity) -> str:
    """Say what the maker states, which no measurement of this very device has shown."""
    for parameter in _calibrated(device):
        stated = parameter.accuracy
        if parameter.quantity == quantity.value and stated is not None:
            if stated.ratio is not None:
                return f" (its maker states {stated.ratio * 100:g} %, which nobody has measured)"
            if stated.absolute is not None:
                told = f"{stated.absolute:g} {parameter.symbol}"
                return f" (its maker states {told}, which nobody has measured)"
    return ""


def _calibrated(device: AdmittedDevice) -> Iterator[ParameterSpec]:
    """Yield every number of a device that its driver says can be calibrated."""
    for action in device.spec.actions:
        yield from (one for one in action.parameters if one.accuracy is not None)
    yield from (one.value for one in device.spec.statuses if one.value.accuracy is not None)


def largest_stroke_nl(device: AdmittedDevice, syringe_nl: int) -> int:
    """Return the largest volume that one stroke may move: nothing beyond what was calibrated."""
    found = in_force(device, CalibrationQuantity.VOLUME)
    return syringe_nl if found is None else min(syringe_nl, int(found.levels[-1].value * 1000))


def correct_step(draft: DraftStep, drafting: Drafting) -> DraftStep:
    """Give devices the numbers that make what the step asks for true.

    Findings are noted for numbers that a device does not take once they are corrected.
    """
    jobs = tuple(
        job if job.choices else correct_job(draft.step, job, drafting) for job in draft.jobs
    )
    return replace(draft, jobs=jobs)


def correct_job(step: Step, job: DraftJob, drafting: Drafting) -> DraftJob:
    """Correct the arguments of one job, and what its conditions want of corrected statuses."""
    made = tuple(_with_needs(step, one) for one in _corrections(job))
    args = {**job.args, **{one.argument: one.sent for one in made if one.sent is not None}}
    devices = {device.id: device for device in drafting.view.devices}
    if made:
        for problem in (*_check_sent(job, args, drafting), *_check_range(job, made)):
            drafting.refuse(step, problem.code, problem.message, context=problem.context)
    return replace(
        job,
        args=args,
        corrections=made,
        pre=tuple(_as_device_tells(one, devices.get(one.device_id)) for one in job.pre),
        post=tuple(_as_device_tells(one, devices.get(one.device_id)) for one in job.post),
    )


def _with_needs(step: Step, one: Correction) -> Correction:
    """Keep with a correction how sure the step wants it, to be looked at again when it is sent."""
    sort = ACCURACIES[one.quantity]
    asked = STEP_KINDS[step.kind].parameter("accuracy")
    if "accuracy" not in step.params or asked is None or asked.quantity != sort:
        return one
    return msgspec.structs.replace(one, needs=parse(step.params["accuracy"], sort))


def _corrections(job: DraftJob) -> Iterator[Correction]:
    for parameter in job.device.spec.action(job.action).parameters:
        value = job.args.get(parameter.name)
        found = _in_force_for(job.device, parameter)
        if found is not None and isinstance(value, int | float) and not isinstance(value, bool):
            yield correction_of(found, parameter.name, float(value))
    if isinstance(job.operation, Read):
        for status in job.device.spec.statuses:
            found = _in_force_for(job.device, status.value)
            if found is not None and status.name in job.operation.statuses:
                yield correction_of(found, status.name, None)


def _in_force_for(device: AdmittedDevice, parameter: ParameterSpec) -> AcceptedCalibration | None:
    if parameter.accuracy is None or parameter.quantity not in set(CalibrationQuantity):
        return None
    return in_force(device, CalibrationQuantity(parameter.quantity))


def _check_sent(job: DraftJob, args: dict[str, object], drafting: Drafting) -> list[Finding]:
    """List what the device cannot be told, on its own scale."""
    found = check_arguments(job.device.spec.action(job.action), args)
    found += beyond_limits(job.device, job.action, args, drafting.view.tree)
    syringe_ul = setting(job.device, "syringe_ul")
    sent = args.get("volume_ul")
    if syringe_ul is not None and isinstance(sent, float) and sent > syringe_ul:
        text = (
            f"{job.device.name} would have to move {sent:.5g} µL by its own scale, which ends at "
            f"{syringe_ul:g} µL"
        )
        found.append(Finding("calibration.beyond_scale", text))
    return found


def _check_range(job: DraftJob, made: Iterable[Correction]) -> Iterator[Finding]:
    """Refuse temperatures beyond those that were compared: a line says nothing of them."""
    for one in made:
        found = in_force(job.device, one.quantity)
        if (
            one.quantity is not CalibrationQuantity.TEMPERATURE
            or one.asked is None
            or found is None
        ):
            continue
        first, last = found.levels[0], found.levels[-1]
        if not first.value - first.expanded <= one.asked <= last.value + last.expanded:
            text = (
                f"{job.device.name} was calibrated from {first.value:.5g} to {last.value:.5g} °C; "
                f"of {one.asked:g} °C nothing is known: ask for one between, or withdraw "
                f"calibration {found.number} and calibrate it over a wider range"
            )
            yield Finding("calibration.out_of_range", text)


def _as_device_tells(condition: Condition, device: AdmittedDevice | None) -> Condition:
    """Return a condition on a true value as one on what the device tells."""
    if device is None:
        return condition
    told = next((s.value for s in device.spec.statuses if s.name == condition.status), None)
    found = None if told is None else _in_force_for(device, told)
    if found is None:
        return condition
    return msgspec.structs.replace(
        condition,
        low=None if condition.low is None else found.device_of(condition.low),
        high=None if condition.high is None else found.device_of(condition.high),
        change=None if condition.change is None else round(condition.change / found.gain, DIGITS),
    )
