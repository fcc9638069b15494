"""Where a job stands, from what its host reported of the last try."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from labweb.domain.errors import ReconcileError, StateError
from labweb.domain.runs.states.host_event_meaning import read_event
from labweb.domain.runs.states.job_states import UNSTARTED, JobState


def job_state(events: Iterable[tuple[str, Mapping[str, Any]]]) -> JobState:
    """Fold (kind, body) of a dispatched action's events, in the order of its host's journal.

    Raises:
        ReconcileError: `rebuild.job`: an event cannot follow the ones before it.

    Example:
        >>> job_state([("accepted", {}), ("started", {}), ("actuated", {})]).value
        'completing'
    """
    state = JobState.DISPATCHED
    for kind, body in events:
        try:
            meaning = read_event(kind, body, state)
        except (StateError, ValueError, KeyError) as error:
            raise ReconcileError(
                f"{kind} cannot follow {state.value}: {error}", code="rebuild.job"
            ) from error
        state = meaning.state or state
    return state


def server_state(current: JobState) -> JobState:
    """Return the state of a job that is the server's own again, of which no event tells.

    A person has queued it anew, or its host gave it back: from then on the server alone holds,
    queues and stops it, and no host can have carried it further.

    Example:
        >>> server_state(JobState.HELD).value, server_state(JobState.COMPLETE).value
        ('held', 'queued')
    """
    return current if current in UNSTARTED | {JobState.STOPPED} else JobState.QUEUED
