"""Jobs while they are being planned, and the one way to make them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any
from uuid import UUID

from msgspec import UNSET

from labweb.domain.calibration.correction import Correction
from labweb.domain.crutd.operations import Operation, Read, TransferLiquid, Update
from labweb.domain.crutd.pre_and_postconditions import Condition
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.enrollment.driver_spec import check_arguments
from labweb.domain.errors import Finding
from labweb.domain.resources.contents_by_lot import Contents, LotId, Phase
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.passes.role_requirements import (
    acting_node,
    beyond_limits,
    post_conditions,
    read_statuses,
    recorded_data,
)
from labweb.domain.workflows.plan import LotStatement
from labweb.domain.workflows.unit_operations.step_palette import STEP_KINDS
from labweb.domain.workflows.workflow_file import Step

FIELD_BY_ARGUMENT = {
    "temperature_c": "params.temperature",
    "speed_rpm": "params.stir_speed",
    "rate_ul_s": "params.flow_rate",
    "volume_ul": "params.volume",
    "port_index": "params.pump",
}
"""Which field of a step's form an argument of an action comes from."""

_TIMED = frozenset({"aspirate", "dispense", "hold", "wait"})
"""Actions whose duration follows from their arguments, and is no estimate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MassCheck:
    """A balance that must see what a dispense brings."""

    balance: AdmittedDevice
    node_id: UUID
    may_stay_unconfirmed: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class DraftJob:
    """One action on one device, before its place in the plan is known."""

    step_id: str
    sentence: str
    device: AdmittedDevice
    action: str
    args: Mapping[str, Any]
    operation: Operation
    pre: tuple[Condition, ...] = ()
    post: tuple[Condition, ...] = ()
    locks: frozenset[UUID] = frozenset()
    estimate_s: float = 0.0
    mass_check: MassCheck | None = None
    corrections: tuple[Correction, ...] = ()
    """Arguments that a calibration has changed, as asked and as sent."""

    meets_next: bool = False
    """It begins at the same moment as the job after it, which receives what this one gives."""

    asks: str = ""
    """What a person has to confirm before it is sent to a host; empty: nothing."""

    states: LotStatement | None = None
    """What a person states in its place; None: nothing."""

    choices: tuple[DraftJob, ...] = ()
    """The same on each device that may do it, corrected; empty: on this one alone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DraftStep:
    """One step with its jobs in order."""

    step: Step
    jobs: tuple[DraftJob, ...] = ()
    whole: TransferLiquid | None = None
    """For a step that moves liquid: the move as the person asked for it."""

    pump_ids: tuple[UUID, ...] = ()
    """For a step that moves liquid: the syringes that do it, in the order of flow."""

    empties: bool = False
    """The step empties the syringe, so the syringe has to hold something before it."""

    notes: tuple[str, ...] = ()


@dataclass(kw_only=True)
class Drafting:
    """What planning one workflow on one lab shares between its steps."""

    view: PlannerView
    earlier: Mapping[str, frozenset[str]]
    """By step: the steps that are done before it starts."""

    findings: list[Finding] = field(default_factory=list)
    contents: Callable[[UUID], Contents]
    """What a vessel holds at this point of the plan."""

    masses: Callable[[UUID], Contents]
    """What a vessel holds by then of what is counted by mass, in micrograms."""

    products: dict[str, LotId] = field(default_factory=dict)
    """By key: the lots that reactions of this plan make."""

    phases: dict[str, Phase] = field(default_factory=dict)
    """Of the lots that reactions of this plan make, by key."""

    timer_users: dict[UUID, list[str]] = field(default_factory=dict)

    def refuse(self, step: Step, code: str, message: str, at: str = "", **context: object) -> None:
        """Note why a step cannot be planned."""
        found = Finding(code, message, step.id, {"field": at, **context})
        if found not in self.findings:
            self.findings.append(found)

    def lot(self, key: str) -> LotId | None:
        """Return the lot of that key, one of this plan too; None: there is none."""
        return self.products.get(key) or self.view.lots.get(key)

    def key_of(self, lot: LotId) -> str:
        """Return what a person calls a lot: its key, else its id."""
        known = {**self.view.lots, **self.products}
        return next((key for key, one in known.items() if one == lot), str(lot))

    def solids(self, vessel: UUID) -> dict[LotId, int]:
        """Return the solid lots in a vessel at this point of the plan, in micrograms."""
        known = {} if self.view.facts is None else self.view.facts.lots
        found = {}
        for lot, amount_ug in self.masses(vessel).items():
            made = self.phases.get(self.key_of(lot))
            phase = known[lot].phase if lot in known else made
            if amount_ug and phase is not Phase.GAS:
                found[lot] = amount_ug
        return found

    def name(self, resource_id: UUID) -> str:
        """Return what a person calls a resource."""
        return self.view.tree.find(resource_id).name

    def job(  # noqa: PLR0913 - a job is what it is made of; all but four are keywords
        self,
        step: Step,
        device: AdmittedDevice,
        action: str,
        args: Mapping[str, Any],
        *,
        sentence: str,
        operation: Operation | None = None,
        pre: Iterable[Condition] = (),
        post: Iterable[Condition] = (),
        locks: Iterable[UUID] = (),
        estimate_s: float = 0.0,
        mass_check: MassCheck | None = None,
        sample_id: UUID | None = None,
    ) -> DraftJob | None:
        """Make one job, or note why the device cannot do it and return None."""
        spec = device.spec.action(action)
        wrong = [(one, f"{device.name}: {one.message}") for one in check_arguments(spec, args)]
        beyond = beyond_limits(device, action, args, self.view.tree)
        problems = wrong or [(one, one.message) for one in beyond]
        for problem, message in problems:
            at = _field_of(step, problem.subject.rpartition(".")[2])
            self.refuse(step, problem.code, message, at, **problem.context)
        node_id = acting_node(device, action)
        if node_id is None:
            message = f"{device.name} does not say which of its resources does {action!r}"
            self.refuse(step, "plan.no_node", message, device=device.key)
        is_in_time = self._is_in_time(step, device, action, estimate_s)
        if problems or node_id is None or not is_in_time:
            return None
        if operation is None:
            measured = UNSET if sample_id is None else sample_id
            operation = (
                Read(
                    device_id=node_id,
                    statuses=read_statuses(device, action),
                    sample_id=measured,
                )
                if spec.operation == "read"
                else Update(
                    resource_id=node_id,
                    data=recorded_data(action, args),
                    needs_empty=action == "initialize",
                    sample_id=measured,
                )
            )
        return DraftJob(
            step_id=step.id,
            sentence=sentence,
            device=device,
            action=action,
            args=dict(args),
            operation=operation,
            pre=tuple(pre),
            post=(*post_conditions(device, action, args), *post),
            locks=frozenset({*device.nodes.values(), *locks}),
            estimate_s=estimate_s,
            mass_check=mass_check,
        )

    def _is_in_time(self, step: Step, device: AdmittedDevice, action: str, takes_s: float) -> bool:
        limit_s = device.spec.action(action).timeout_s
        if action not in _TIMED or limit_s is None or takes_s <= limit_s:
            return True
        message = (
            f"{action} of {device.name} would take {takes_s:g} s; its driver allows {limit_s:g} s"
        )
        self.refuse(step, "plan.too_long", message, action=action, limit_s=limit_s)
        return False


def _field_of(step: Step, argument: str) -> str:
    """Return the field of the step's form that an argument of an action comes from."""
    known = {parameter.name for parameter in STEP_KINDS[step.kind].parameters}
    if "args" in known:
        return f"params.args.{argument}"
    at = FIELD_BY_ARGUMENT.get(argument, f"params.args.{argument}")
    is_known = at.removeprefix("params.") in known
    return "params.pump" if not is_known and "pump" in known else at
