"""The endpoints of runs and jobs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar
from uuid import UUID

import msgspec
from django.db.models import QuerySet
from msgspec.structs import replace
from rest_framework.request import Request

from labweb.accounts.api import Endpoint, check_scope, is_by_token
from labweb.accounts.selectors import User, user_of
from labweb.common.answers import NumberedRef
from labweb.common.database.reading import one_moment
from labweb.common.lists import HISTORY, STANDING
from labweb.common.requests import Parameter, body
from labweb.crutd import api as crutd_api
from labweb.crutd import selectors as crutd_selectors
from labweb.crutd.answers import EventList
from labweb.crutd.selectors.doubt_resolutions import resolved_of
from labweb.domain.approvals.access_tokens import AccessScope
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import DefinitionError, NotFoundError
from labweb.domain.graph.lab_file.lab_model import LabMode
from labweb.domain.runs.after_failure.plan_departures import Departure
from labweb.domain.runs.host_journal.surroundings import without_surroundings
from labweb.domain.runs.states.job_states import RunState
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.runs import selectors, services
from labweb.runs.answers.jobs import JobRow
from labweb.runs.answers.run_rows import RunList
from labweb.runs.answers.runs import LogLine, RunDetail, RunLogPage
from labweb.runs.api import run_details, run_log
from labweb.runs.api.jobs import render_job
from labweb.runs.models import HostEvent, Job, Run
from labweb.workflows import selectors as workflow_selectors

_LONGEST_SHOWN = 40

MOST_UL = 1e9
"""A cubic metre; more is a slip of the keys."""


class StartRun(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a start."""

    version_id: UUID
    plan_digest: str | None = None
    """Of the plan that the caller saw; without it the present plan is started."""

    is_second: bool = False
    """Start it though another run of the version has not begun."""


class Reason(msgspec.Struct, forbid_unknown_fields=True):
    """Body of an act that needs a reason."""

    reason: str


class Resume(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a resume."""

    departures: list[Departure] | None = None
    """How the run leaves what was proved, as the caller has seen it, to go on without a proof."""

    pauses: list[str] | None = None
    """When each pause that the caller has seen began: with one more the run is not resumed."""


class DoubtAnswer(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a resolution."""

    answer: str
    note: str
    moved_ul: float | None = None
    attempt_id: UUID | None = None
    """Which doubt is answered: the try of the job, as the question names it. It may be left out
    while the job has been in doubt but once."""

    despite_reading: bool = False
    """The answer stands though the device reads otherwise."""

    then: str | None = None
    """What follows: `retry`, `skip`, `done_by_hand` or `abort`."""

    then_moved_ul: float | None = None
    """With `done_by_hand`: how much was moved by hand."""


def visible(run_id: UUID, user: User) -> Run:
    """Return a run the user may see.

    Raises:
        NotFoundError: There is none, or it uses something they may not know of.
    """
    run = selectors.find_run(run_id)
    if not _is_seen(run, user):
        raise NotFoundError(f"no run {run_id}", code="run.not_found")
    return run


def visible_job(job_id: UUID, user: User) -> Job:
    """Return a job of a run the user may see; raises as `visible`."""
    job = selectors.find_job(job_id)
    if not _is_seen(job.run, user):
        raise NotFoundError(f"no job {job_id}", code="job.not_found")
    return job


def _is_seen(run: Run, user: User) -> bool:
    return visible_runs(run.lab, user).filter(pk=run.pk).exists()


def visible_runs(lab: Lab, user: User) -> QuerySet[Run]:
    """The runs of a lab that the user may see."""
    seen = resource_selectors.allowed_ids(user, Permission.VIEW)
    return selectors.visible_runs(lab, seen)


def check_own(request: Request, run: Run) -> None:
    """Refuse a token what is another person's run; whoever is signed in needs none.

    Raises:
        ForbiddenError: The owner of the token has not started it, or its lab is a real one and
            the token is for simulated ones.
    """
    if not is_by_token(request):
        return
    is_own = run.created_by_id == user_of(request).pk
    check_scope(request, scope_on(run.lab) if is_own else None)


def scope_on(lab: Lab) -> AccessScope:
    """Return the scope that a token needs to act on the runs of a lab."""
    return AccessScope.SIMULATE if lab.mode == LabMode.SIM else AccessScope.SUBMIT


class Runs(Endpoint):
    """Runs of the lab."""

    scopes: ClassVar[Mapping[str, AccessScope]] = {"post": AccessScope.SIMULATE}
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": StartRun}
    statuses: ClassVar[Mapping[str, int]] = {"post": 201}
    queries: ClassVar[Mapping[str, Parameter]] = {
        "state": Parameter({"type": "string"}, "States of runs, with commas between."),
        **HISTORY.parameters,
    }

    def get(self, request: Request) -> RunList:
        """List runs, newest first."""
        rows = visible_runs(resource_selectors.the_lab(), user_of(request))
        states = [s for s in request.query_params.get("state", "").split(",") if s]
        unknown = [s for s in states if s not in set(RunState)]
        if unknown:
            known = ", ".join(RunState)
            text = (
                f"there is no state {unknown[0][:_LONGEST_SHOWN]!r} of runs; state lists some of "
                f"{known}, with commas between"
            )
            raise DefinitionError(text, code="http.query")
        if states:
            rows = rows.filter(state__in=states)
        with one_moment():
            found, following = HISTORY.of_rows(request, rows, "-number")
            return RunList(runs=run_details.render_rows(found), next=following)

    def post(self, request: Request) -> RunDetail:
        """Start a version, or ask for approval where a policy wants it."""
        user = user_of(request)
        wanted = body(request, StartRun)
        version = workflow_selectors.visible_version(wanted.version_id, user)
        if is_by_token(request):
            check_scope(request, scope_on(version.workflow.lab))
        run = services.start_run(
            version,
            actor=user,
            seen_digest=wanted.plan_digest,
            is_asked=not wanted.is_second,
        )
        return run_details.render_run(run, user)


class OneRun(Endpoint):
    """One run."""

    def get(self, request: Request, run_id: UUID) -> RunDetail:
        """Return a run whole."""
        user = user_of(request)
        with one_moment():
            return run_details.render_run(visible(run_id, user), user)


class RunEvents(Endpoint):
    """CRUTD events of one run."""

    queries = HISTORY.parameters

    def get(self, request: Request, run_id: UUID) -> EventList:
        """List what the run's transactions did, newest first."""
        run = visible(run_id, user_of(request))
        ids = run.jobs.values_list("id", flat=True)
        rows = crutd_selectors.events_of(run.lab, job_ids=ids)
        events, following = HISTORY.of_rows(request, rows, "-seq")
        found = crutd_api.event_rows(events)
        for event in found:
            event.run = NumberedRef(id=run.id, number=run.number)
        return EventList(events=found, next=following)


class RunLog(Endpoint):
    """What hosts reported of one run."""

    queries = STANDING.parameters

    def get(self, request: Request, run_id: UUID) -> RunLogPage:
        """List host events of the run's actions, oldest first."""
        run = visible(run_id, user_of(request))
        tries = [
            (attempt, job)
            for job in selectors.jobs_of(run).prefetch_related("attempts")
            for attempt in job.attempts.all()
        ]
        jobs = {attempt.id: job for attempt, job in tries}
        told: list[HostEvent | LogLine] = [
            *selectors.host_events(list(jobs)),
            *run_log.render_hand_overs(run),
        ]
        page, following = STANDING.of_list(request, told, run_log.place_of)
        by_transaction = resolved_of(attempt.transaction_id for attempt, _ in tries)
        ends = {one.id: by_transaction.get(one.transaction_id) for one, _ in tries}
        root = resource_selectors.root_of(run.lab).id
        is_all_seen = root in resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
        lines = [
            line if isinstance(line, LogLine) else run_log.render_reported(line, jobs, ends)
            for line in page
        ]
        if not is_all_seen:
            lines = [replace(line, body=without_surroundings(line.body)) for line in lines]
        return RunLogPage(lines=lines, next=following)


class PauseRun(Endpoint):
    """A pause."""

    scopes: ClassVar[Mapping[str, AccessScope]] = {"post": AccessScope.SIMULATE}

    def post(self, request: Request, run_id: UUID) -> RunDetail:
        """Let nothing more of the run begin, and return it."""
        user = user_of(request)
        check_own(request, visible(run_id, user))
        services.pause_run(run_id, actor=user)
        return run_details.render_run(selectors.find_run(run_id), user)


class ResumeRun(Endpoint):
    """The end of a pause."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Resume}

    def post(self, request: Request, run_id: UUID) -> RunDetail:
        """Let the run go on, and return it."""
        user, seen = user_of(request), body(request, Resume)
        visible(run_id, user)
        services.resume_run(run_id, actor=user, departures=seen.departures, pauses=seen.pauses)
        return run_details.render_run(selectors.find_run(run_id), user)


class AbortRun(Endpoint):
    """The end of a run before its time."""

    scopes: ClassVar[Mapping[str, AccessScope]] = {"post": AccessScope.SIMULATE}
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Reason}

    def post(self, request: Request, run_id: UUID) -> RunDetail:
        """Have the run end, and return it."""
        user, reason = user_of(request), body(request, Reason).reason
        check_own(request, visible(run_id, user))
        services.abort_run(run_id, actor=user, reason=reason)
        return run_details.render_run(selectors.find_run(run_id), user)


def whole_nl(volume_ul: float) -> int:
    """Turn microlitres of a request into nanolitres.

    Raises:
        DefinitionError: It is no volume of any laboratory.
    """
    if not 0 < volume_ul < MOST_UL:
        raise DefinitionError(f"{volume_ul} µL cannot have moved", code="run.bad_amount")
    amount_nl = round(volume_ul * 1000)
    if not amount_nl:
        message = f"{volume_ul:g} µL is less than a nanolitre, the least that is recorded"
        raise DefinitionError(message, code="run.bad_amount")
    return amount_nl


class RecoveryAnswer(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a recovery."""

    choice: str
    note: str
    moved_ul: float | None = None
    params: dict[str, Any] | None = None


class RecoverJob(Endpoint):
    """What becomes of a job that ended undone."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": RecoveryAnswer}

    def post(self, request: Request, job_id: UUID) -> RunDetail:
        """Carry out a person's choice and return the run."""
        user = user_of(request)
        wanted = body(request, RecoveryAnswer)
        visible_job(job_id, user)
        job = services.recover_job(
            job_id,
            actor=user,
            choice=wanted.choice,
            note=wanted.note,
            moved_nl=_by_hand_nl(wanted.moved_ul),
            params=wanted.params,
        )
        return run_details.render_run(selectors.find_run(job.run_id), user)


class Confirmation(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a person confirms, or states in the place of a job."""

    stated: dict[str, str] | None = None
    """Amount by the key of a lot, where the job asks for that: `{"brine": "all"}`."""


class ConfirmJob(Endpoint):
    """What a person confirms or states before a job is sent."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Confirmation}

    def post(self, request: Request, job_id: UUID) -> RunDetail:
        """Let the job go, or plan the rest again with what is stated; return the run."""
        user = user_of(request)
        wanted = body(request, Confirmation)
        visible_job(job_id, user)
        job = services.confirm_job(job_id, actor=user, stated=wanted.stated)
        return run_details.render_run(selectors.find_run(job.run_id), user)


def _by_hand_nl(moved_ul: float | None) -> int | None:
    """None moved is an amount, too: the device may have moved all of it before it failed."""
    return None if moved_ul is None else 0 if moved_ul == 0 else whole_nl(moved_ul)


class ResolveJob(Endpoint):
    """What happened in a job in doubt."""

    signs = frozenset({"post"})
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": DoubtAnswer}

    def post(self, request: Request, job_id: UUID) -> JobRow:
        """Send a person's answer to the host."""
        user = user_of(request)
        answer = body(request, DoubtAnswer)
        moved = None if answer.moved_ul is None else whole_nl(answer.moved_ul)
        beside = services.Beside(
            attempt_id=answer.attempt_id,
            despite_reading=answer.despite_reading,
            then=answer.then or "",
            then_moved_nl=_by_hand_nl(answer.then_moved_ul),
        )
        visible_job(job_id, user)
        services.resolve_job(
            job_id,
            actor=user,
            answer=answer.answer,
            moved_nl=moved,
            note=answer.note,
            beside=beside,
        )
        job = selectors.find_job(job_id)
        attempt = selectors.last_attempt(job)
        waiting = selectors.answers_under_way([] if attempt is None else [attempt.id])
        names = run_details.names_of(job.run.lab)
        return render_job(job, attempt, names, waiting)
