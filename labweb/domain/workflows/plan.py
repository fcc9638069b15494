"""The Plan: what a workflow means on one lab, action by action."""

from __future__ import annotations

import hashlib
from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.calibration.correction import Correction
from labweb.domain.crutd.operations import Operation
from labweb.domain.crutd.pre_and_postconditions import Condition
from labweb.domain.resources.contents_by_lot import Phase


class CapableDevice(msgspec.Struct, frozen=True, kw_only=True):
    """One device that may do a job which asks for a role, and what the job is there."""

    device_id: UUID
    host_id: UUID
    args: dict[str, Any]
    operation: Operation
    pre: tuple[Condition, ...] = ()
    post: tuple[Condition, ...] = ()
    locks: tuple[UUID, ...] = ()
    recovery: str = "R3"
    corrections: tuple[Correction, ...] = ()


class LotStatement(msgspec.Struct, frozen=True, kw_only=True):
    """What of each lot in a vessel a person states during the run."""

    field: str
    """Parameter of the step that takes it."""

    label: str
    """What a person calls that parameter."""

    resource_id: UUID
    """The vessel."""

    phases: tuple[Phase, ...] = (Phase.LIQUID,)
    """Which of its lots."""

    leaves_out: bool = True
    """With nothing of any lot there is nothing to do, and the step is left out."""


class PlannedJob(msgspec.Struct, frozen=True, kw_only=True):
    """One action on one device, with its one Transaction."""

    index: int
    """Place in the plan, from 0."""

    step_id: str
    """Step of the workflow it belongs to."""

    sentence: str
    """What a person reads: "Aspirate 5.00 mL from Water bottle"."""

    device_id: UUID
    action: str
    args: dict[str, Any]
    """As the device is given them: corrected where a calibration is in force."""

    operation: Operation
    after: tuple[int, ...] = ()
    """Jobs that must have completed."""

    pre: tuple[Condition, ...] = ()
    """Checked at the edge on fresh readings just before the start."""

    post: tuple[Condition, ...] = ()
    locks: tuple[UUID, ...] = ()
    """Resources held exclusively: device nodes, vessels, valves on the route."""

    estimate_s: float = 0.0
    recovery: str = "R3"
    corrections: tuple[Correction, ...] = ()
    """Arguments that a calibration has changed, as asked and as sent."""

    choices: tuple[CapableDevice, ...] | msgspec.UnsetType = msgspec.UNSET
    """Devices of which the first that is free does it, that above before all; unset: that one."""

    meets: int | msgspec.UnsetType = msgspec.UNSET
    """Job on another device of the same host: both begin at the same moment, or none does. The
    first of the two gives and the second, which is next in the plan, receives."""

    asks: str | msgspec.UnsetType = msgspec.UNSET
    """What a person has to confirm before it is sent to a host; unset: nothing."""

    states: LotStatement | msgspec.UnsetType = msgspec.UNSET
    """What a person states in its place: all that is left of the run is planned again with it,
    and this job is never sent; unset: nothing."""

    @property
    def receives(self) -> bool:
        """Say whether it is the second of two jobs that begin at the same moment."""
        return isinstance(self.meets, int) and self.meets < self.index

    def ways(self) -> tuple[PlannedJob | CapableDevice, ...]:
        """Return the job as each device that may do it would do it."""
        return self.choices or (self,)


class PlannedStep(msgspec.Struct, frozen=True, kw_only=True):
    """One step of the workflow as the plan sees it."""

    step_id: str
    kind: str
    sentence: str
    estimate_s: float = 0.0


class Execution(msgspec.Struct, frozen=True, kw_only=True):
    """How the hosts of a run behave while the server is away."""

    on_disconnect: str
    """`continue`, `finish_current_then_hold` or `stop_safe`."""

    max_offline_s: float
    """For `continue`: nothing begins when the server has been away for longer."""


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    """Ordered actions of one workflow version on one state of one lab."""

    version: int = 1
    steps: tuple[PlannedStep, ...]
    jobs: tuple[PlannedJob, ...]
    notes: tuple[str, ...] = ()
    """What a reader should know: unknown dead volumes on the route."""

    execution: Execution | None = None
    """None: jobs go one by one, and a host finishes what it has been given."""


def encode(plan: Plan) -> bytes:
    """Render as canonical JSON."""
    return msgspec.json.encode(plan, order="sorted")


def digest(plan: Plan) -> str:
    """Return the SHA-256 of the canonical form; what an approval signs."""
    return hashlib.sha256(encode(plan)).hexdigest()
