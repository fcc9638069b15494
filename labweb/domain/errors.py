"""What can go wrong, and what each failure may have done to matter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, ClassVar


class Effect(StrEnum):
    """What the failed operation may have done to the physical lab."""

    NONE = "none"
    """Nothing moved. The digital record still holds; a retry is safe."""

    PARTIAL = "partial"
    """A known part happened; `context` says which. Record it, then re-plan."""

    UNKNOWN = "unknown"
    """Nobody knows. Quarantine the resources and ask a person to look."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One reason why something may not go."""

    code: str
    """Stable and documented, `area.reason`."""

    message: str
    """What was asked, what is true, what to do."""

    subject: str = ""
    """What it is about: a resource, step or file position, as a path or an id."""

    context: Mapping[str, Any] = field(default_factory=dict)
    """JSON-ready facts behind the message."""

    def to_json(self) -> dict[str, Any]:
        """Render as plain data for an answer or a record."""
        return {
            "code": self.code,
            "message": self.message,
            "subject": self.subject,
            "context": dict(self.context),
        }


class LabError(Exception):
    """A failure the caller can act on. `effect` says what may have happened to matter."""

    default_code: ClassVar[str] = "lab.error"
    default_effect: ClassVar[Effect] = Effect.NONE

    def __init__(
        self,
        message: str,
        *,
        code: str | None = None,
        effect: Effect | None = None,
        context: Mapping[str, Any] | None = None,
        findings: Sequence[Finding] = (),
    ) -> None:
        super().__init__(message)
        self.message = message
        self.code = code or self.default_code
        self.effect = effect or self.default_effect
        self.context: dict[str, Any] = dict(context or {})
        self.findings = tuple(findings)

    def to_json(self) -> dict[str, Any]:
        """Render as plain data for an answer or a record."""
        return {
            "code": self.code,
            "message": self.message,
            "effect": self.effect.value,
            "context": self.context,
            "findings": [finding.to_json() for finding in self.findings],
        }


class DefinitionError(LabError):
    """A file or source is wrong. Nothing changed."""

    default_code = "definition.invalid"


class LabFileError(DefinitionError):
    """A lab file cannot be read whole; `findings` name node and field."""

    default_code = "lab_file.invalid"


class ProtocolError(DefinitionError):
    """A workflow or protocol is malformed."""

    default_code = "protocol.invalid"


class UnitError(DefinitionError):
    """A quantity cannot be read, or has the wrong dimension."""

    default_code = "unit.invalid"


class ConformanceError(DefinitionError):
    """Driver source breaks the conformance rules; `findings` carry file and line."""

    default_code = "driver.conformance"


class StateError(LabError):
    """The right request at the wrong moment. Nothing changed."""

    default_code = "state.conflict"


class NotFoundError(StateError):
    """No such thing, or none the caller may know of."""

    default_code = "state.not_found"


class PreconditionError(StateError):
    """A precondition does not hold; `findings` list each."""

    default_code = "state.precondition"


class LockedError(StateError):
    """Somebody else holds the resource; `context` says who and since when."""

    default_code = "state.locked"


class RevisionError(StateError):
    """Somebody wrote in between; read again."""

    default_code = "state.revision"


class PlanningError(LabError):
    """This lab cannot do what was asked. Nothing changed."""

    default_code = "plan.impossible"


class NoRouteError(PlanningError):
    """Target cannot be reached; `context["reached"]` lists what could be."""

    default_code = "plan.no_route"


class InfeasibleError(PlanningError):
    """The plan breaks a limit; `findings` list each."""

    default_code = "plan.infeasible"


class GovernanceError(LabError):
    """The actor may not. Nothing changed."""

    default_code = "governance.refused"


class ForbiddenError(GovernanceError):
    """The actor lacks the permission."""

    default_code = "governance.forbidden"


class EnrollmentError(GovernanceError):
    """Host or device is not admitted."""

    default_code = "governance.not_enrolled"


class InterlockError(GovernanceError):
    """An interlock tripped: UNKNOWN while acting, NONE before the start."""

    default_code = "governance.interlock"


class DeviceError(LabError):
    """An instrument failed while acting."""

    default_code = "device.failed"
    default_effect = Effect.UNKNOWN


class UnreachableError(DeviceError):
    """No link. Raise with `Effect.NONE` when it failed before the first byte."""

    default_code = "device.unreachable"


class DeviceTimeoutError(DeviceError):
    """No answer in time."""

    default_code = "device.timeout"


class RejectedError(DeviceError):
    """The device refused, and by its manual did not move."""

    default_code = "device.rejected"
    default_effect = Effect.NONE


class FrameError(DeviceError):
    """Bad checksum or a reply that does not parse."""

    default_code = "device.frame"


class ReconcileError(LabError):
    """Record and world disagree."""

    default_code = "reconcile.disagrees"
    default_effect = Effect.UNKNOWN
