"""The edge host's side of one action: a pure state machine over its journal rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any
from uuid import UUID

from labweb.domain.action_files import NamedFile
from labweb.domain.crutd.pre_and_postconditions import (
    Condition,
    ConditionResult,
    ConditionVerdict,
    Verification,
    verification_of,
)
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.domain.errors import Effect, Finding


class ActionState(StrEnum):
    """Where an action stands in the journal."""

    ACCEPTED = "accepted"
    STARTED = "started"
    """On disk before the first byte to the device."""

    ACTUATED = "actuated"
    """The device has answered; what follows only reads."""

    COMPLETE = "complete"
    ABORTED = "aborted"
    REJECTED = "rejected"
    STOPPED = "stopped"
    IN_DOUBT = "in_doubt"


FINAL = frozenset(
    {ActionState.COMPLETE, ActionState.ABORTED, ActionState.REJECTED, ActionState.STOPPED}
)
OPEN = frozenset(
    {ActionState.ACCEPTED, ActionState.STARTED, ActionState.ACTUATED, ActionState.IN_DOUBT}
)


@dataclass(frozen=True, slots=True, kw_only=True)
class HostState:
    """What the host's journal says about the host itself."""

    host_id: UUID
    epoch: int
    floor: int
    boot_id: str
    armed_boot_id: str | None
    stop_latched: bool
    offline_since_s: float | None = None
    """Monotonic second of this boot since which the server is away; None: it is there."""

    halted: Mapping[str, int] = field(default_factory=dict)
    """By device: the last dispatch that had started there when it was halted."""

    owes_halt: frozenset[str] = frozenset()
    """Devices that had to be halted and could not be reached: each is, before it acts again."""

    server_clock: str = ""
    """Clock of the server of which the session told; empty: none in this start of the machine."""

    server_ahead_s: float = 0.0
    """That clock less the own monotonic one: at most so much, since the answer took its time."""


@dataclass(frozen=True, slots=True)
class HostAnswer:
    """A decision with its reason."""

    kind: str
    code: str = ""
    message: str = ""


NEVER_S = float("inf")
"""Age of an action of which nobody knows how long it has waited."""

ACCEPT, DUPLICATE, DROP, REFUSE = "accept", "duplicate", "drop", "refuse"
START, REJECT, HOLD = "start", "reject", "hold"


def decide_accept(
    host: HostState,
    *,
    host_id: UUID,
    epoch: int,
    dseq: int,
    known: ActionState | None,
    is_tombstoned: bool,
) -> HostAnswer:
    """Decide what to do with an envelope whose signature holds.

    A message of another epoch or below the floor is void: the server has other proof of
    what became of it, so it is dropped without a trace in the event log.
    """
    if host_id != host.host_id:
        return HostAnswer(REFUSE, "envelope.wrong_host", "the command names another host")
    if known is not None:
        return HostAnswer(DUPLICATE)
    if epoch != host.epoch:
        return HostAnswer(DROP, "envelope.old_epoch", f"epoch {epoch}, session is {host.epoch}")
    if dseq < host.floor:
        return HostAnswer(DROP, "envelope.below_floor", f"dispatch {dseq}, floor is {host.floor}")
    if is_tombstoned:
        return HostAnswer(REFUSE, "envelope.cancelled", "it was cancelled before it arrived")
    return HostAnswer(ACCEPT)


@dataclass(frozen=True, slots=True, kw_only=True)
class ActionCandidate:
    """The next accepted action of a device, with what decides whether it may start."""

    dseq: int
    max_fence: int
    """Highest dispatch sequence that has acted on the device."""

    age_s: float
    """Since its acceptance, on the monotonic clock."""

    ttl_s: float
    numbers_hold_s: float | None = None
    """For how long its calibration holds; None: no calibration has a say."""

    sent_age_s: float = 0.0
    """Since the server signed it, by the server's clock that nobody sets; 0: not comparable."""

    device_blocked_by: str | None = None
    """Action in doubt on the same device."""

    owes_halt: bool = False
    """The device had to be halted, and was not yet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HostScene:
    """What a worker knows when it wants to start an action."""

    pid: int
    driver_digest: str
    prestate: dict[str, Any] = field(default_factory=dict)
    """Readings from just before."""

    context: dict[str, Any] = field(default_factory=dict)
    """Versions and readings of this moment, as `context_body` gives them."""

    judged: Sequence[tuple[Condition, ConditionResult]] = ()
    """Pre-conditions with their verdicts on readings from just before."""


def decide_start(
    host: HostState,
    candidate: ActionCandidate,
    *,
    turn: HostAnswer | None = None,
    findings: Sequence[Finding],
    results: Sequence[ConditionResult],
) -> HostAnswer:
    """Decide whether the next accepted action of a device may start now.

    HOLD leaves it accepted (a person or the server has to act first); REJECT ends it
    without any effect on matter. `turn` is what its batch says; None: nothing against it.
    """
    held = _decide_hold(host, candidate.device_blocked_by)
    if held is not None:
        return held
    if candidate.dseq < host.floor:
        return HostAnswer(REJECT, "edge.below_floor", "the server has given it up")
    if candidate.dseq < candidate.max_fence:
        fence = candidate.max_fence
        return HostAnswer(REJECT, "edge.fenced", f"fence {fence} has passed this device")
    against = _decide_late(candidate) or turn
    if against is not None:
        return against
    if candidate.owes_halt:
        return HostAnswer(
            HOLD, "edge.halt_owed", "its device has to be halted first, once it answers"
        )
    if findings:
        return HostAnswer(REJECT, findings[0].code, findings[0].message)
    failed = [result for result in results if result.verdict is not ConditionVerdict.PASS]
    if failed:
        return HostAnswer(REJECT, failed[0].name, failed[0].message)
    return HostAnswer(START)


def _decide_late(candidate: ActionCandidate) -> HostAnswer | None:
    """Reject what has waited for too long, be it for itself or for the numbers that it has."""
    age_s, ttl_s = candidate.age_s, candidate.ttl_s
    if age_s == NEVER_S:
        return HostAnswer(
            REJECT, "edge.rebooted", "the machine was restarted since it was accepted"
        )
    if age_s > ttl_s:
        why = "; its device is still to be halted first" if candidate.owes_halt else ""
        text = f"waited {age_s:.0f} s, may wait {ttl_s:.0f} s{why}"
        return HostAnswer(REJECT, "edge.expired", text)
    oldest_s = max(age_s, candidate.sent_age_s)
    if candidate.numbers_hold_s is not None and oldest_s >= candidate.numbers_hold_s:
        text = "the calibration that made its numbers has ended: calibrate the device, then resume"
        return HostAnswer(REJECT, "calibration.expired", text)
    return None


def _decide_hold(host: HostState, device_blocked_by: str | None) -> HostAnswer | None:
    if host.stop_latched:
        return HostAnswer(HOLD, "edge.stopped", "the lab is stopped; a person has to reset it")
    if host.armed_boot_id != host.boot_id:
        return HostAnswer(HOLD, "edge.not_armed", "the machine was restarted and nobody armed it")
    if device_blocked_by is not None:
        return HostAnswer(HOLD, "edge.in_doubt", f"action {device_blocked_by} is in doubt here")
    return None


def recover(state: ActionState) -> ActionState:
    """Return the state a row takes when its executor comes back after a crash.

    STARTED without an answer is in doubt: nobody can tell whether the device acted.
    """
    return ActionState.IN_DOUBT if state is ActionState.STARTED else state


@dataclass(frozen=True, slots=True, kw_only=True)
class ActionReport:
    """What came back from the driver."""

    ok: bool
    effect: Effect = Effect.NONE
    """Meaningful when not ok."""

    moved_nl: int | None = None
    code: str = ""
    message: str = ""
    evidence: dict[str, Any] = field(default_factory=dict)
    data: dict[str, Any] = field(default_factory=dict)
    """Statuses to store with the resource."""

    files: tuple[NamedFile, ...] = ()
    """What the action hands over; the bytes are on the host's disk before this is written."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Conclusion:
    """How an action ends."""

    state: ActionState
    outcome: Outcome
    verification: Verification
    code: str = ""
    message: str = ""


def conclude(
    report: ActionReport,
    post: Sequence[tuple[Condition, ConditionResult]],
    *,
    only_reads: bool = False,
    is_undone_by_halt: bool = False,
) -> Conclusion:
    """Decide how an action ends from the device's report and the post-conditions.

    A sensor that contradicts the device means that nobody knows: in doubt, with both
    numbers as evidence for the person who resolves it. So does whatever had to confirm and
    could not be observed, unless the step says that it may stay unconfirmed: then the action
    is complete, *unconfirmed*, and the message says what could not be seen. An action that
    only reads leaves no doubt: what it had to see was not seen, and it is aborted.
    So is one that was to set what a halt takes away again, where its device was halted and has
    told how far it came.
    """
    if not report.ok:
        is_known = report.code == HALTED_CODE and (only_reads or is_undone_by_halt)
        return _conclude_failure(report, moved_nl=0 if is_known else None)
    failed = [
        result
        for condition, result in post
        if result.verdict is ConditionVerdict.FAIL
        or (result.verdict is ConditionVerdict.UNOBSERVABLE and not condition.may_stay_unconfirmed)
    ]
    if failed and only_reads:
        return Conclusion(
            state=ActionState.ABORTED,
            outcome=Outcome(kind=OutcomeKind.PARTIAL, moved_nl=0),
            verification=Verification.DEVICE,
            code=failed[0].name,
            message=failed[0].message,
        )
    if failed:
        return Conclusion(
            state=ActionState.IN_DOUBT,
            outcome=Outcome(kind=OutcomeKind.UNKNOWN),
            verification=Verification.ASSUMED,
            code=failed[0].name,
            message=failed[0].message,
        )
    unseen = [
        result.message for _, result in post if result.verdict is ConditionVerdict.UNOBSERVABLE
    ]
    return Conclusion(
        state=ActionState.COMPLETE,
        outcome=Outcome(kind=OutcomeKind.DONE, moved_nl=report.moved_nl, data=report.data),
        verification=verification_of(post, reported=True),
        code="edge.unconfirmed" if unseen else "",
        message=f"not confirmed: {'; '.join(unseen)}" if unseen else "",
    )


HALTED_CODE = "device.stopped"
"""What a driver says of an action that a halt has ended."""


def _conclude_failure(report: ActionReport, *, moved_nl: int | None) -> Conclusion:
    """Conclude a failure; `moved_nl` is what is known of a part that no volume tells."""
    moved_nl = moved_nl if report.moved_nl is None else report.moved_nl
    kinds = {
        Effect.NONE: (ActionState.ABORTED, Outcome(kind=OutcomeKind.PARTIAL, moved_nl=0)),
        Effect.PARTIAL: (
            ActionState.ABORTED,
            Outcome(kind=OutcomeKind.PARTIAL, moved_nl=moved_nl),
        ),
        Effect.UNKNOWN: (ActionState.IN_DOUBT, Outcome(kind=OutcomeKind.UNKNOWN)),
    }
    effect = report.effect
    if effect is Effect.PARTIAL and moved_nl is None:
        effect = Effect.UNKNOWN
    state, outcome = kinds[effect]
    is_known = state is ActionState.ABORTED
    return Conclusion(
        state=state,
        outcome=outcome,
        verification=Verification.DEVICE if is_known else Verification.ASSUMED,
        code=report.code,
        message=report.message,
    )


ANSWERS = ("happened", "did_not", "partly", "discard")


def resolve(answer: str, *, moved_nl: int | None) -> tuple[ActionState, Outcome] | None:
    """Turn a person's answer about an action in doubt into its end.

    `discard` ends the action as aborted and leaves its resources quarantined; the outcome
    stays unknown. None: the answer is none of `ANSWERS`, or `partly` lacks its amount.
    """
    if answer == "happened":
        return ActionState.COMPLETE, Outcome(kind=OutcomeKind.DONE)
    if answer == "did_not":
        return ActionState.ABORTED, Outcome(kind=OutcomeKind.PARTIAL, moved_nl=0)
    if answer == "partly" and moved_nl is not None and moved_nl > 0:
        return ActionState.ABORTED, Outcome(kind=OutcomeKind.PARTIAL, moved_nl=moved_nl)
    if answer == "discard":
        return ActionState.ABORTED, Outcome(kind=OutcomeKind.UNKNOWN)
    return None
