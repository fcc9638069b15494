"""Home and search: what needs a person, what runs, where things are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from typing import ClassVar
from uuid import UUID

from django.db.models import Q, QuerySet
from msgspec.structs import replace
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, permissions_of, user_of
from labweb.api.answers.home import HomeNeed, HomePage, NeedKind
from labweb.api.answers.search import SearchHit, SearchHits
from labweb.approvals import selectors as approval_selectors
from labweb.calibration import selectors as calibration_selectors
from labweb.common import disk
from labweb.common.database.reading import one_moment
from labweb.common.requests import Parameter
from labweb.crutd import selectors as crutd_selectors
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.disk_space import DiskRoomLevel
from labweb.domain.resources.resource_kinds import is_vessel
from labweb.domain.units import render_volume
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import Device, EdgeHost
from labweb.fleet.api.devices import device_rows
from labweb.fleet.api.hosts import host_rows
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.runs import selectors as run_selectors
from labweb.runs import services as run_services
from labweb.runs.api.run_details import names_of, render_rows
from labweb.runs.api.workflows import workflow_rows
from labweb.runs.selectors import Job, Run

_MOST = 8
_SHORTEST_QUERY = 2
_MOST_FOUND = 40
_PAUSED_BY = {
    "stopped": "paused because the lab was stopped",
    "device_stopped": "paused because a device of it was stopped",
}
_MOST_SINGLE = 3
"""Finds that are shown one by one; more are one line."""


class Home(Endpoint):
    """What a person sees first."""

    def get(self, request: Request) -> HomePage:
        """Return what needs somebody, what runs, and what was done last."""
        with one_moment():
            return _home(user_of(request))


def _home(user: User) -> HomePage:
    lab = resource_selectors.the_lab()
    seen = resource_selectors.allowed_ids(user, Permission.VIEW)
    runs = run_selectors.visible_runs(lab, seen)
    devices = enrollment_selectors.visible_devices(lab, seen)
    candidates = [row for row in devices if row.state == Device.State.CANDIDATE]
    hosts = enrollment_selectors.visible_hosts(lab, user)
    may_admit = Permission.ADMIT in permissions_of(user)
    return HomePage(
        needs_you=[
            *_short_disks(hosts, DiskRoomLevel.FULL),
            *_needs(lab, runs, candidates if may_admit else [], seen),
            *(_newcomers(lab) if may_admit else ()),
            *_short_disks(hosts, DiskRoomLevel.LOW),
        ],
        running=render_rows(runs.filter(state__in=[*run_selectors.LIVE, "awaiting_approval"])[:20]),
        last_results=render_rows(
            runs.filter(state__in=["complete", "aborted"]).order_by("-ended_at")[:_MOST]
        ),
        workflows=workflow_rows(lab, seen)[:_MOST],
        devices=device_rows(devices),
        hosts=host_rows(hosts),
    )


def _needs(
    lab: Lab, runs: QuerySet[Run], candidates: Iterable[Device], seen: set[UUID]
) -> Iterator[HomeNeed]:
    shown = runs.values("pk")
    if lab.is_stopped:
        yield _need(
            "stopped", "The lab is stopped", "Nothing starts before a person resets it",
            lab.stopped_at, "/", "Reset",
        )  # fmt: skip
    names = names_of(lab)
    for job in run_selectors.jobs_in_doubt(lab).filter(run__in=shown):
        need = _need(
            "in_doubt", _question(job, names), _where(job, names),
            job.state_at, f"/runs/{job.run_id}?job={job.id}", "Resolve",
        )  # fmt: skip
        yield replace(need, run_id=job.run_id, job_id=job.id)
    for job in run_selectors.jobs_that_ask(runs):
        need = _need(
            "asks", job.asks, f"Run #{job.run.number} {job.run.version.workflow.name}",
            job.state_at, f"/runs/{job.run_id}?job={job.id}", "Open",
        )  # fmt: skip
        yield replace(need, run_id=job.run_id, job_id=job.id)
    measured = calibration_selectors.measured_in(shown).values("pk")
    about = Q(run_id__in=shown) | Q(calibration_id__in=measured)
    for row in approval_selectors.requests_of(lab).filter(about, state="open"):
        need = _need(
            "approval", row.title, f"Asked by {row.asked_by.printed_name} · {row.policies[0]}",
            row.asked_at, f"/approvals?id={row.id}", "Review",
        )  # fmt: skip
        yield replace(need, run_id=row.run_id, request_id=row.id)
    for row in approval_selectors.open_about_drivers(lab):
        yield _need(
            "approval", row.title, f"Asked by {row.asked_by.printed_name} · {row.policies[0]}",
            row.asked_at, f"/drivers/{row.driver_id}", "Review",
        )  # fmt: skip
    for halt in run_selectors.owed_halts(lab.pk):
        if enrollment_selectors.is_seen(halt.device, seen):
            yield _need(
                "halt_owed", f"{halt.device.name} could not be halted yet", halt.message,
                halt.at, f"/devices/{halt.device_id}", "Open",
            )  # fmt: skip
    yield from _paused(runs)
    yield from _silent(runs)
    yield from _unreconciled(lab, seen)
    for device in candidates:
        yield _need(
            "candidate", f"{device.name} was found on {device.host.name}",
            "It may do nothing until an admin has reviewed it", device.discovered_at,
            f"/admin/enrollment/device/{device.id}/review/", "Review",
        )  # fmt: skip


def _short_disks(hosts: Iterable[EdgeHost], level: DiskRoomLevel) -> Iterator[HomeNeed]:
    """Disks of the server and of hosts that stand so, before anything fails for want of room."""
    floors, server = disk.floors(), disk.server_disk()
    told = enrollment_selectors.disks_of(hosts)
    found = [("", server), *((f"/hosts/{host.pk}", one) for host, one in told)]
    for url, one in found:
        if one is not None and one.level(floors) is level:
            verb = "Open host" if url else ""
            yield _need("disk", one.headline(), one.consequence(floors), None, url, verb)


def _newcomers(lab: Lab) -> Iterator[HomeNeed]:
    """Machines that ask to become hosts, and what hosts have seen; many of these as one."""
    for asking in enrollment_selectors.waiting_requests(lab):
        known = asking.known_host
        yield _need(
            "candidate", f"{asking.name} asks to become an edge host",
            "Compare the code that it shows" if known is None
            else f"It says that it is {known.name}, which is suspended meanwhile",
            asking.asked_at, f"/admin/enrollment/joinrequest/{asking.id}/review/", "Review",
        )  # fmt: skip
    found = enrollment_selectors.new_candidates(lab)
    if len(found) > _MOST_SINGLE:
        yield _need(
            "candidate", f"{len(found)} things were found that may be devices",
            "They may do nothing until an admin has reviewed them", found[0].first_seen_at,
            "/admin/enrollment/candidate/?state__exact=new", "Look",
        )  # fmt: skip
        return
    for one in found:
        meant = None if one.key_changed_from is None else one.key_changed_from.device
        yield _need(
            "candidate", f"{one.name or one.address} was found by {one.host.name}",
            "It may do nothing until an admin has reviewed it" if meant is None
            else f"It says that it is {meant.name}, and has not its key", one.first_seen_at,
            f"/admin/enrollment/candidate/{one.id}/review/", "Review",
        )  # fmt: skip


def _unreconciled(lab: Lab, seen: set[UUID]) -> Iterator[HomeNeed]:
    for closed in crutd_selectors.given_up(lab):
        row = closed.resource
        if row.id not in seen:
            continue
        is_full = is_vessel(row.kind)
        yield _need(
            "quarantined",
            f"Nobody knows what {row.name} holds" if is_full
            else f"Nobody knows what became of {row.name}",
            "Nothing uses it until a person has looked and taken stock",
            closed.at, f"/lab?sel={row.id}&stock=1", "Take stock",
        )  # fmt: skip
    for ticket in crutd_selectors.visible_tickets(lab, seen):
        title, _, rest = ticket.message.partition(": ")
        yield _need(
            "ticket", title, rest or ticket.code,
            ticket.opened_at, f"/lab?ticket={ticket.id}", "Open",
        )  # fmt: skip


def _paused(runs: QuerySet[Run]) -> Iterator[HomeNeed]:
    for run in run_selectors.runs_that_wait(runs):
        title = f"Run #{run.number} {run.version.workflow.name} is {run.state}"
        since = min((one["at"] for one in run.pause_reasons), default=None)
        at = run.created_at if since is None else datetime.fromisoformat(since)
        need = _need("paused", title, _why_paused(run), at, f"/runs/{run.id}", "Open")
        yield replace(need, run_id=run.id)


def _silent(runs: QuerySet[Run]) -> Iterator[HomeNeed]:
    """Devices of the runs on which something stands that nobody can read back."""
    found = run_selectors.silent_devices()
    known = {one.run.id for one in found}
    shown = set(runs.filter(pk__in=known).values_list("pk", flat=True)) if known else known
    for one in found:
        if one.run.id not in shown:
            continue
        sentences = "; ".join(job.sentence for job in one.jobs)
        run = f"Run #{one.run.number} {one.run.version.workflow.name}"
        title = f"{one.device.name} is not read: nobody knows whether it keeps what was set"
        detail = f"{run} goes on. Set: {sentences}. Look at {one.device.name}"
        need = _need("silent", title, detail, one.since_at, f"/runs/{one.run.id}", "Open")
        yield replace(need, run_id=one.run.id)


def _why_paused(run: Run) -> str:
    taken = next(iter(run_selectors.halted_jobs(run)), None)
    if taken is not None:
        return f"{taken.sentence}: {run_services.why_taken(taken)}"
    bad = run.jobs.filter(state__in=["aborted", "rejected", "stopped", "held"]).first()
    if bad is not None:
        return f"{bad.sentence}: {bad.message}"
    return _PAUSED_BY.get(
        next((one["kind"] for one in run.pause_reasons), ""), "paused by a person"
    )


def _need(
    kind: NeedKind, title: str, detail: str, since_at: datetime | None, url: str, verb: str
) -> HomeNeed:
    return HomeNeed(
        kind=kind,
        title=title,
        detail=detail,
        since_at=since_at,
        url=url,
        verb=verb,
        run_id=None,
        job_id=None,
        request_id=None,
    )


def _question(job: Job, names: dict[str, str]) -> str:
    operation = job.operation
    if operation.get("op") != "transfer_liquid":
        return f"Did this happen: {job.sentence}?"
    source, target = names.get(operation["source_id"]), names.get(operation["target_id"])
    return f"Was {render_volume(operation['amount_nl'])} moved from {source} to {target}?"


def _where(job: Job, names: dict[str, str]) -> str:
    del names
    workflow = job.run.version.workflow.name
    return f"In doubt · Run #{job.run.number} {workflow} · {job.device.name}: {job.message}"


class Search(Endpoint):
    """Find anything by name."""

    queries: ClassVar[Mapping[str, Parameter]] = {
        "q": Parameter({"type": "string"}, "Part of a name, at least two letters.")
    }

    def get(self, request: Request) -> SearchHits:
        """Return resources, devices, runs, workflows and lots whose name has the text."""
        seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
        text = request.query_params.get("q", "").strip().lower()[:100]
        if len(text) < _SHORTEST_QUERY:
            return SearchHits(results=[])
        lab = resource_selectors.the_lab()
        found = [*_places(lab, text, seen), *_work(lab, text, seen)]
        return SearchHits(results=found[:_MOST_FOUND])


def _places(lab: Lab, text: str, seen: set[UUID]) -> Iterator[SearchHit]:
    for node in resource_selectors.resources_of(lab):
        if node.id in seen and text in f"{node.name} {node.key} {node.id}".lower():
            yield SearchHit("resource", node.id, node.name, node.kind, f"/lab?sel={node.id}")
    for device in enrollment_selectors.visible_devices(lab, seen):
        if text in f"{device.name} {device.key} {device.id}".lower():
            detail = device.driver.class_name
            yield SearchHit("device", device.id, device.name, detail, f"/devices/{device.id}")
    for lot in crutd_selectors.visible_lots(lab, seen):
        if text in f"{lot} {lot.key}".lower():
            yield SearchHit("lot", lot.id, str(lot), lot.key, "/lab")


def _work(lab: Lab, text: str, seen: set[UUID]) -> Iterator[SearchHit]:
    for row in workflow_rows(lab, seen):
        if text in row.name.lower():
            url = f"/workflows/{row.id}/edit"
            yield SearchHit("workflow", row.id, row.name, "workflow", url)
    for run in run_selectors.runs_named(run_selectors.visible_runs(lab, seen), text)[:_MOST_FOUND]:
        name = f"Run #{run.number} {run.version.workflow.name}"
        yield SearchHit("run", run.id, name, run.state, f"/runs/{run.id}")
