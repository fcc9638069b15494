"""What a person may do about a job that ended undone, and what each choice leads to."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from uuid import UUID

from labweb.domain.runs.halts.halted_setpoints import LET_GO
from labweb.domain.runs.states.job_states import FINAL, UNSTARTED, JobState

UNDONE = frozenset({JobState.ABORTED, JobState.REJECTED, JobState.STOPPED})
MOST_TRIES = 3
"""After so many equal failures another try is refused: something else is wrong."""


class RunWaitCause(StrEnum):
    """What a person has to say before a run can go on."""

    ANSWER = "answer"
    """What an action did of which nobody knows the outcome."""

    RECOVERY = "recovery"
    """What becomes of a job that ended undone, or that a halt undid."""


def may_retry(state: JobState) -> bool:
    """Say whether a job may be tried anew: its last try has ended, and not as complete."""
    return state in UNDONE


@dataclass(frozen=True, slots=True, kw_only=True)
class Partner:
    """The job that has to begin at the same moment as one that ended undone."""

    sentence: str
    why_not: str
    """Why it cannot be sent with the other one; empty: it can."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """A job that ended undone, as recovery sees it."""

    index: int
    state: JobState
    step_id: str
    recovery: str
    """R0 ask the device, R1 an absolute set-point, R2 measurable, R3 opaque."""

    has_moved: bool
    """Its last try moved a known part."""

    is_liquid: bool
    is_mass: bool = False
    """It books a solid that a person has weighed in."""

    is_unknown: bool = False
    """A try of it was given up in doubt: nobody knows what amount it moved."""

    halted_by: str = ""
    """It is complete, and a halt of its device has taken away what it had set: why."""

    failures: int = 1
    """Tries that ended with the same code, the last included."""

    partner: Partner | None = None
    """The job that has to begin at the same moment; None: it goes alone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LaterJob:
    """A job that has not ended, as far as a choice bears on it."""

    index: int
    step_id: str
    state: JobState
    after: tuple[int, ...]
    uses: frozenset[UUID]
    meets: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PersonChoice:
    """One thing that a person may do."""

    name: str
    """`retry`, `skip`, `done_by_hand` or `change`."""

    why_not: str = ""
    """Empty: it is offered."""

    consequence: str
    """What it leads to, in one sentence."""


def choices_for(job: Ended, *, is_step_untouched: bool) -> tuple[PersonChoice, ...]:
    """List what a person may do, each with its consequence or why it is not offered.

    A second try of what has moved a part, or nobody knows how much, is offered for set-points
    alone: for a pour it would pour the whole amount on top.

    Args:
        job: The job.
        is_step_untouched: No action of its step has moved anything.
    """
    if is_taken_away(job.state, job.halted_by):
        return _after_halt()
    return (
        _retry(job),
        _change(job, is_step_untouched=is_step_untouched),
        _by_hand(job),
        _skip(job),
    )


def is_taken_away(state: JobState, halted_by: str) -> bool:
    """Say whether a halt took away what a completed job had set, and nobody has answered."""
    return state is JobState.COMPLETE and halted_by not in {"", LET_GO}


def waits_for(state: JobState, *, is_passed: bool, halted_by: str) -> RunWaitCause | None:
    """Return what a person has to say of a job before its run can go on; None: nothing.

    Args:
        state: Where the job stands.
        is_passed: A person has decided what becomes of it.
        halted_by: Why a halt of its device undid it; empty: none did.
    """
    if state is JobState.IN_DOUBT:
        return RunWaitCause.ANSWER
    is_undone = may_retry(state) and not is_passed
    return RunWaitCause.RECOVERY if is_undone or is_taken_away(state, halted_by) else None


def run_waits_for(jobs: Iterable[RunWaitCause | None]) -> RunWaitCause | None:
    """Return what a run waits for, of what its jobs wait for: what was done comes first."""
    waits = set(jobs)
    return next((one for one in RunWaitCause if one in waits), None)


def _after_halt() -> tuple[PersonChoice, ...]:
    again = "Sends the action again, as another action, before all that follows it in the plan."
    go_on = "Leaves the device as it is. What follows starts if its conditions hold."
    why_not = "it was done, and what it had set is gone: do it again, or go on without"
    return (
        PersonChoice(name="retry", consequence=again),
        PersonChoice(name="change", why_not=why_not, consequence=""),
        PersonChoice(name="done_by_hand", why_not=why_not, consequence=""),
        PersonChoice(name="skip", consequence=go_on),
    )


def why_not_with(job: Ended, *, is_passed: bool) -> str:
    """Say why a job cannot be sent anew with the one that it meets; empty: it can."""
    if is_passed:
        return "that one is passed over"
    return "" if job.state in UNSTARTED else _retry(job).why_not


def _retry(job: Ended) -> PersonChoice:
    consequence = "Sends the action again, as another action, when you resume the run."
    why_not = ""
    if not may_retry(job.state):
        why_not = f"the job is {job.state.value}, not undone"
    elif job.has_moved and job.recovery != "R1":
        why_not = "a part has moved: a second try would move the whole amount on top of it"
    elif job.is_unknown and job.recovery != "R1":
        why_not = "what it moved is not known: a second try would move the whole amount on top"
    elif job.partner is not None and job.partner.why_not:
        why_not = f"it moves together with {job.partner.sentence!r}: {job.partner.why_not}"
    elif job.failures >= MOST_TRIES:
        why_not = f"it failed {job.failures} times in the same way; find the cause first"
    return PersonChoice(name="retry", why_not=why_not, consequence=consequence)


def _change(job: Ended, *, is_step_untouched: bool) -> PersonChoice:
    why_not = ""
    if not may_retry(job.state):
        why_not = f"the job is {job.state.value}, not undone"
    elif not is_step_untouched:
        why_not = "something of this step has moved already"
    text = "Plans this step anew with other values, and all that follows with the lab as it is."
    return PersonChoice(name="change", why_not=why_not, consequence=text)


def _by_hand(job: Ended) -> PersonChoice:
    why_not = "" if may_retry(job.state) else f"the job is {job.state.value}, not undone"
    if not why_not and job.partner is not None and not job.is_liquid:
        why_not = f"what is poured by hand is written down at {job.partner.sentence!r}"
    text = "Counts the job as done: you did it. "
    if job.is_mass:
        text += "The record moves the mass that was planned."
    elif not job.is_liquid:
        text += "Nothing is sent."
    elif job.has_moved:
        text += "The record adds the amount that you name to what the device has moved."
    else:
        text += "The record moves the amount that you name."
    return PersonChoice(name="done_by_hand", why_not=why_not, consequence=text)


def _skip(job: Ended) -> PersonChoice:
    why_not = "" if may_retry(job.state) else f"the job is {job.state.value}, not undone"
    text = (
        "Leaves it undone, with the rest of its step. What follows starts if its conditions hold."
    )
    return PersonChoice(name="skip", why_not=why_not, consequence=text)


def skipped_with(job: Ended, later: Sequence[LaterJob]) -> list[int]:
    """Return the jobs that are skipped with a job: what is left of its step behind or with it."""
    found = {job.index}
    for one in sorted(later, key=lambda each: each.index):
        is_behind = not found.isdisjoint(one.after) or one.meets in found
        if one.step_id == job.step_id and is_behind and one.state not in FINAL:
            found.add(one.index)
    return sorted(found - {job.index})


def relying_on(targets: frozenset[UUID], job: Ended, later: Sequence[LaterJob]) -> list[int]:
    """Return the later jobs, beyond its step, that use what a job was to change."""
    return [
        one.index
        for one in later
        if one.index > job.index
        and one.step_id != job.step_id
        and one.state not in FINAL
        and not targets.isdisjoint(one.uses)
    ]
