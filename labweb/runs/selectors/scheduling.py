"""Reads on the way from a queued job to the door of its host; the locks that are taken there."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any
from uuid import UUID

import msgspec
from django.db.models import DateTimeField, Q, QuerySet, UUIDField

from labweb.common import disk
from labweb.common.database.prepared_queries import Given, Prepared, Question, together
from labweb.domain.disk_space import DiskRoomLevel, DiskSpace
from labweb.domain.errors import LabError, NotFoundError
from labweb.domain.runs.after_failure.recovery_choices import is_taken_away
from labweb.domain.runs.dispatch import job_scheduler
from labweb.domain.runs.dispatch.job_scheduler import JobView
from labweb.domain.runs.halts.halt_progress import UNDECIDED, HaltState
from labweb.domain.runs.states.job_states import UNSTARTED, JobState, RunState
from labweb.domain.workflows.plan import Execution
from labweb.enrollment import selectors as enrollment_selectors
from labweb.resources import selectors as resource_selectors
from labweb.runs.models import Attempt, DeviceHalt, Outbox
from labweb.runs.models import Custody as Custody
from labweb.runs.models import Job as Job
from labweb.runs.models import Run as Run
from labweb.runs.selectors.custody import hosts_of_carry


def run_for_update(run_id: UUID) -> Run:
    """Lock and return a run. Whoever locks several locks host, then run, then jobs.

    Raises:
        NotFoundError: There is none.
    """
    row = RUN_TO_LOCK.first(id=run_id)
    if row is None:
        raise NotFoundError(f"no run {run_id}", code="run.not_found")
    return row


RUN_TO_LOCK = Prepared(
    lambda: (
        Run.objects.filter(pk=Given("id", UUIDField()))
        .select_for_update(of=("self",), no_key=True)
        .defer("plan")
    )
)


def job_for_update(job_id: UUID) -> Job:
    """Lock and return a job with its run and device.

    Raises:
        NotFoundError: There is none.
    """
    row = JOB_TO_LOCK.first(id=job_id)
    if row is None:
        raise NotFoundError(f"no job {job_id}", code="job.not_found")
    return row


JOB_TO_LOCK = Prepared(
    lambda: (
        Job.objects.filter(pk=Given("id", UUIDField()))
        .select_for_update(of=("self",), no_key=True)
        .select_related("run__lab", "device__host", "device__driver")
        .defer("run__plan", "device__driver__spec", "device__driver__sources")
    )
)


def views(run_id: UUID) -> list[JobView]:
    """Return what scheduling needs to know of a run's jobs."""
    return [_view(*row) for row in _VIEWS.rows(run=run_id)]


_VIEW = (
    "id",
    "index",
    "state",
    "after",
    "device__host_id",
    "passed_by",
    "operation__op",
    "operation__resource_id",
    "operation__to_id",
    "run__lab_id",
    "choices",
    "halted_by",
    "meets",
    "asks",
    "confirmed_at",
)

_VIEWS = Prepared(
    lambda: (
        Job.objects.filter(run_id=Given("run", UUIDField())).order_by("index").values_list(*_VIEW)
    )
)


def _view(  # noqa: PLR0913 - one column each
    job_id: UUID,
    index: int,
    state: str,
    after: list[int],
    host_id: UUID,
    passed_by: str,
    op: str | None,
    resource_id: str | None,
    to_id: str | None,
    lab_id: UUID,
    choices: list[dict[str, Any]],
    halted_by: str,
    meets: int | None,
    asks: str,
    confirmed_at: datetime | None,
) -> JobView:
    is_carry = op == "transfer_resource"
    owners: frozenset[UUID] = frozenset()
    if is_carry and JobState(state) in UNSTARTED:
        thing, place = UUID(resource_id), UUID(to_id)
        owners = hosts_of_carry(resource_selectors.labs().get(pk=lab_id), thing, place)
    return JobView(
        id=job_id,
        index=index,
        state=JobState(state),
        after=tuple(after),
        host_id=host_id,
        meets=meets,
        choice_host_ids=frozenset(UUID(one["host_id"]) for one in choices),
        owner_ids=owners,
        is_passed=bool(passed_by),
        is_carry=is_carry,
        is_asking=bool(asks) and confirmed_at is None,
        is_taken_away=is_taken_away(JobState(state), halted_by),
    )


def asking(run: Run) -> frozenset[UUID]:
    """Return the jobs of a run that wait for nothing but a person who confirms them."""
    if run.pause_reasons or run.is_given_up:
        return frozenset()
    return job_scheduler.asking(views(run.id))


@dataclass(frozen=True, slots=True)
class ToSchedule:
    """What a turn of the scheduler looks at."""

    online: set[UUID]
    """Hosts that may get new work."""

    short_of_room: set[UUID]
    """Those of them whose disk has too little room for a run to be begun there."""

    runs: list[tuple[UUID, Execution | None, list[JobView]]]
    """Runs with work left, oldest first, none of a stopped lab; with each what its workflow
    declares for the time its hosts cannot hear the server, and its jobs."""

    senseless: dict[UUID, Exception]
    """Runs of which what is kept cannot be read."""


def to_schedule() -> ToSchedule:
    """Return what may be dispatched now; one exchange."""
    hosts, runs, jobs = together(
        enrollment_selectors.READY.asking(), _TO_SCHEDULE.asking(), _JOBS_TO_SCHEDULE.asking()
    )
    known: dict[UUID, list[tuple[Any, ...]]] = {}
    for run_id, *columns in jobs:
        known.setdefault(run_id, []).append(tuple(columns))
    disks = {host_id: enrollment_selectors.disk_of(name, beat) for host_id, name, beat in hosts}
    short = {host_id for host_id, one in disks.items() if one and _is_full(one)}
    found = ToSchedule(online=set(disks), short_of_room=short, runs=[], senseless={})
    for run_id, declared in runs:
        try:
            execution = None if declared is None else msgspec.convert(declared, Execution)
            found.runs.append((run_id, execution, [_view(*row) for row in known.get(run_id, ())]))
        except (LabError, ValueError, KeyError, TypeError, AttributeError) as error:
            found.senseless[run_id] = error
    return found


def _is_full(one: DiskSpace) -> bool:
    return one.level(disk.floors()) is DiskRoomLevel.FULL


_WITH_WORK = {
    "state__in": [RunState.QUEUED.value, RunState.RUNNING.value],
    "lab__is_stopped": False,
}

_TO_SCHEDULE = Prepared(
    lambda: (
        Run.objects.filter(**_WITH_WORK).order_by("created_at").values_list("id", "plan__execution")
    )
)

_JOBS_TO_SCHEDULE = Prepared(
    lambda: (
        Job.objects.filter(**{f"run__{name}": value for name, value in _WITH_WORK.items()})
        .order_by("run_id", "index")
        .values_list("run_id", *_VIEW)
    )
)


HALTING_AT = Prepared(
    lambda: (
        DeviceHalt.objects.filter(host_id=Given("host", UUIDField()), ended_at__isnull=True)
        .order_by()
        .values_list("device_id")
    )
)
"""The devices of a host that are to be halted before anything is sent to them."""


_HALTS = DeviceHalt.objects.select_related("device", "run", "asked_by")


def halts_of(run: Run) -> QuerySet[DeviceHalt]:
    """Halts of devices that an aborted run had set, in the order in which they were asked for."""
    return _HALTS.filter(run=run).order_by("at")


def open_halts(device_ids: Iterable[UUID]) -> dict[UUID, DeviceHalt]:
    """Return of each device the newest halt that was asked for and is not delivered."""
    rows = _HALTS.filter(device_id__in=list(device_ids), ended_at__isnull=True)
    return {row.device_id: row for row in rows.order_by("at")}


def last_halt(device_id: UUID) -> DeviceHalt | None:
    """Return the newest halt that was asked for of a device, however it ended."""
    return _HALTS.filter(device_id=device_id).order_by("-at").first()


def owed_halts(lab_id: UUID) -> list[DeviceHalt]:
    """Return of each device of a lab that could not be halted yet the newest halt it owes."""
    rows = _HALTS.filter(device__host__lab_id=lab_id, state=HaltState.OWED.value)
    return list({row.device_id: row for row in rows.order_by("at")}.values())


def is_halting(run_id: UUID) -> bool:
    """Tell whether nothing is known yet of some device that is to be halted for a run."""
    states = [state.value for state in UNDECIDED]
    return DeviceHalt.objects.filter(run_id=run_id, state__in=states).exists()


def next_number(job: Job) -> int:
    """Return the number of the next try of a job whose host is locked."""
    ((number,),) = together(asking_number(job.pk))
    return int(number)


def asking_number(job_id: UUID) -> Question[int]:
    """Return what finds that number."""
    return Question("SELECT count(*) FROM runs_attempt WHERE job_id = %s", [job_id], _following)


def asking_run_number(lab_id: UUID) -> Question[int]:
    """Return what finds the number of the next run of a lab that is locked."""
    return Question("SELECT max(number) FROM runs_run WHERE lab_id = %s", [lab_id], _following)


def _following(row: Sequence[int | None]) -> int:
    return (row[0] or 0) + 1


def hold_run_of(action_id: UUID) -> None:
    """Lock the run of an action, before its attempt and its job."""
    run_id = Attempt.objects.filter(pk=action_id).values_list("job__run_id", flat=True).first()
    if run_id is not None:
        run_for_update(run_id)


def attempt_for_update(action_id: UUID) -> Attempt | None:
    """Lock and return the attempt an event speaks of, or None."""
    return (
        Attempt.objects.filter(pk=action_id)
        .select_related("job__run", "transaction")
        .defer("job__run__plan")
        .select_for_update(of=("self",), no_key=True)
        .first()
    )


def due_outbox(rung_before: datetime) -> list[Outbox]:
    """Lock and return commands that hosts which are online have not answered, nor heard since then.

    The first `MOST_AT_ONCE` in dispatch order, with their hosts; none that somebody else sends.
    """
    return _DUE.rows(before=rung_before)


MOST_AT_ONCE = 100
"""How many commands one look at the outbox sends; the next one comes at once or a tick later."""


_DUE = Prepared(
    lambda: (
        Outbox.objects.filter(
            Q(published_at__isnull=True) | Q(published_at__lt=Given("before", DateTimeField())),
            settled_at__isnull=True,
            host__in=enrollment_selectors.hosts_online(),
        )
        .select_related("host")
        .select_for_update(skip_locked=True, of=("self",), no_key=True)
        .order_by("id")[:MOST_AT_ONCE]
    )
)
