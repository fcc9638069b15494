"""States of Run and Job, and who may move them."""

from __future__ import annotations

from enum import StrEnum

from labweb.domain.errors import StateError


class RunState(StrEnum):
    """Where one execution of a workflow stands."""

    DRAFT = "draft"
    AWAITING_APPROVAL = "awaiting_approval"
    QUEUED = "queued"
    RUNNING = "running"
    PAUSING = "pausing"
    PAUSED = "paused"
    COMPLETING = "completing"
    COMPLETE = "complete"
    ABORTED = "aborted"


class JobState(StrEnum):
    """Where one step's action stands; exported as ISA-95 job-order states."""

    DRAFT = "draft"
    AWAITING_APPROVAL = "awaiting_approval"
    QUEUED = "queued"
    HELD = "held"
    SUSPENDED = "suspended"
    DISPATCHED = "dispatched"
    ACCEPTED = "accepted"
    RUNNING = "running"
    COMPLETING = "completing"
    IN_DOUBT = "in_doubt"
    COMPLETE = "complete"
    ABORTED = "aborted"
    STOPPED = "stopped"
    REJECTED = "rejected"


class Mover(StrEnum):
    """Who asks for a step."""

    SERVER = "server"
    """People and policies, before dispatch."""

    SCHEDULER = "scheduler"
    EDGE = "edge"
    """An event of the host: the only mover after dispatch."""

    FENCE = "fence"
    """A host is lost or its journal cannot be trusted: what it was given is in doubt."""

    PERSON = "person"
    """A signed answer about an action whose host can tell no more, or the word to try anew.

    A try that has ended stays as it ended; the next one is another action. One that is
    complete is done again only where a halt has taken away what it had set.
    """


_J = JobState
_SERVER, _SCHEDULER, _EDGE, _FENCE = Mover.SERVER, Mover.SCHEDULER, Mover.EDGE, Mover.FENCE
_PERSON = Mover.PERSON

FINAL = frozenset({_J.COMPLETE, _J.ABORTED, _J.STOPPED, _J.REJECTED})
AT_EDGE = frozenset({_J.DISPATCHED, _J.ACCEPTED, _J.RUNNING, _J.COMPLETING})
UNSTARTED = frozenset({_J.DRAFT, _J.AWAITING_APPROVAL, _J.QUEUED, _J.HELD, _J.SUSPENDED})

STEPS: frozenset[tuple[JobState, JobState, Mover]] = frozenset(
    {
        (_J.DRAFT, _J.AWAITING_APPROVAL, _SERVER),
        (_J.DRAFT, _J.QUEUED, _SERVER),
        (_J.DRAFT, _J.STOPPED, _SERVER),
        (_J.AWAITING_APPROVAL, _J.QUEUED, _SERVER),
        (_J.AWAITING_APPROVAL, _J.STOPPED, _SERVER),
        (_J.QUEUED, _J.HELD, _SERVER),
        (_J.HELD, _J.QUEUED, _SERVER),
        (_J.QUEUED, _J.SUSPENDED, _SERVER),
        (_J.SUSPENDED, _J.QUEUED, _SERVER),
        (_J.QUEUED, _J.DISPATCHED, _SCHEDULER),
        (_J.QUEUED, _J.STOPPED, _SERVER),
        (_J.HELD, _J.STOPPED, _SERVER),
        (_J.SUSPENDED, _J.STOPPED, _SERVER),
        (_J.DISPATCHED, _J.ACCEPTED, _EDGE),
        (_J.DISPATCHED, _J.REJECTED, _EDGE),
        (_J.DISPATCHED, _J.STOPPED, _EDGE),
        (_J.DISPATCHED, _J.HELD, _EDGE),
        (_J.ACCEPTED, _J.HELD, _EDGE),
        (_J.ACCEPTED, _J.RUNNING, _EDGE),
        (_J.ACCEPTED, _J.STOPPED, _EDGE),
        (_J.ACCEPTED, _J.REJECTED, _EDGE),
        (_J.RUNNING, _J.COMPLETING, _EDGE),
        (_J.RUNNING, _J.COMPLETE, _EDGE),
        (_J.RUNNING, _J.ABORTED, _EDGE),
        (_J.RUNNING, _J.IN_DOUBT, _EDGE),
        (_J.COMPLETING, _J.COMPLETE, _EDGE),
        (_J.COMPLETING, _J.ABORTED, _EDGE),
        (_J.COMPLETING, _J.IN_DOUBT, _EDGE),
        (_J.IN_DOUBT, _J.COMPLETE, _EDGE),
        (_J.IN_DOUBT, _J.ABORTED, _EDGE),
        (_J.DISPATCHED, _J.IN_DOUBT, _FENCE),
        (_J.ACCEPTED, _J.IN_DOUBT, _FENCE),
        (_J.RUNNING, _J.IN_DOUBT, _FENCE),
        (_J.COMPLETING, _J.IN_DOUBT, _FENCE),
        (_J.IN_DOUBT, _J.COMPLETE, _PERSON),
        (_J.IN_DOUBT, _J.ABORTED, _PERSON),
        (_J.ABORTED, _J.QUEUED, _PERSON),
        (_J.COMPLETE, _J.QUEUED, _PERSON),
        (_J.REJECTED, _J.QUEUED, _PERSON),
        (_J.STOPPED, _J.QUEUED, _PERSON),
    }
)
"""Every allowed step and its mover; what is not listed is refused here and in the database."""


def check_step(current: JobState, wanted: JobState, mover: Mover) -> None:
    """Refuse a step of a Job that the table does not list.

    Raises:
        StateError: `code` is `run.bad_step`; nothing was written.
    """
    if (current, wanted, mover) not in STEPS:
        raise StateError(
            f"{mover.value} cannot take a job from {current.value} to {wanted.value}",
            code="run.bad_step",
        )
