"""What one event of a host means for the job it speaks of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.runs.states.job_states import JobState, Mover, check_step

_J = JobState
_ALL = ("do", "cancel", "resolve")


@dataclass(frozen=True, slots=True, kw_only=True)
class Meaning:
    """What an event asks the server to write."""

    state: JobState | None = None
    """The job's new state; None: it stays where it is."""

    advance: TransactionState | None = None
    """Step of a transaction that is not settled by this event."""

    answered: tuple[str, ...] = ()
    """Commands about the action that need no ringing any more."""

    outcome: Outcome | None = None
    """Settle the transaction with it; None: it is not settled by this event."""

    is_resolution: bool = False
    """A person's answer stands behind it."""


_STEPS = {
    "started": Meaning(state=_J.RUNNING, advance=TransactionState.EXECUTING),
    "actuated": Meaning(state=_J.COMPLETING, advance=TransactionState.CONFIRMING),
}

_ENDS = {
    "complete": _J.COMPLETE,
    "aborted": _J.ABORTED,
    "in_doubt": _J.IN_DOUBT,
    "rejected": _J.REJECTED,
    "stopped": _J.STOPPED,
}


def read_event(kind: str, body: Mapping[str, Any], current: JobState) -> Meaning:
    """Read what an event means for a job, and check that the job may take that step.

    Raises:
        StateError: The job cannot come from where it is to where the event says. The host's
            log and the record tell different stories; nothing may be written.
        ValueError: The body cannot be read.
    """
    meaning = _read(kind, body, current)
    if meaning.state is not None:
        check_step(current, meaning.state, Mover.EDGE)
    return meaning


def _read(kind: str, body: Mapping[str, Any], current: JobState) -> Meaning:
    if kind == "accepted":
        state = _J.ACCEPTED if current is _J.DISPATCHED else None
        return Meaning(state=state, answered=("do",))
    if kind in _STEPS:
        return _STEPS[kind]
    if kind in _ENDS:
        return _read_end(_ENDS[kind], body)
    if kind == "refused":
        return _read_refusal(body, current)
    if kind == "resolved":
        state = JobState(str(body["state"]))
        outcome = read_outcome(body.get("outcome"), state)
        return Meaning(state=state, answered=("resolve",), outcome=outcome, is_resolution=True)
    return Meaning()


def _read_end(state: JobState, body: Mapping[str, Any]) -> Meaning:
    """Read an end. What a host gives back has not begun there, and may be sent again."""
    if state in {_J.STOPPED, _J.REJECTED} and body.get("is_given_back") is True:
        return Meaning(state=_J.HELD, answered=_ALL, outcome=read_outcome(None, state))
    answered = ("do", "cancel") if state is _J.IN_DOUBT else _ALL
    return Meaning(state=state, answered=answered, outcome=read_outcome(body.get("outcome"), state))


def _read_refusal(body: Mapping[str, Any], current: JobState) -> Meaning:
    """Read a refusal. Only a refused `do` of a job that has not begun ends the job.

    A `do` that a cancel has overtaken is refused after the job was stopped, and a refused
    answer leaves its job in doubt.
    """
    command = str(body.get("command", "do")) or "do"
    if command == "do" and current is _J.DISPATCHED:
        return _read_end(_J.REJECTED, body)
    return Meaning(answered=(command,))


def read_outcome(value: Mapping[str, Any] | None, state: JobState) -> Outcome:
    """Read what is known after acting; without it nothing moved, or nobody knows."""
    if value is None:
        unknown = state is _J.IN_DOUBT
        kind = OutcomeKind.UNKNOWN if unknown else OutcomeKind.PARTIAL
        return Outcome(kind=kind, moved_nl=None if unknown else 0)
    moved = value.get("moved_nl")
    return Outcome(
        kind=OutcomeKind(value["kind"]),
        moved_nl=None if moved is None else int(moved),
        data=value.get("data") or {},
    )
