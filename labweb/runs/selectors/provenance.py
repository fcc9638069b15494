"""All that led to a thing and all that it touched, as one graph."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any
from uuid import UUID

from labweb.accounts.selectors import User
from labweb.crutd.selectors import lineage
from labweb.crutd.selectors import provenance as crutd
from labweb.crutd.selectors.provenance import FOREVER, Window
from labweb.domain.approvals.roles import Permission
from labweb.domain.crutd.provenance.build import build_graph
from labweb.domain.crutd.provenance.facts import (
    DecisionFact,
    FileFact,
    JobFact,
    Record,
    RunFact,
    TransactionFact,
)
from labweb.domain.crutd.provenance.flows import Flow, is_nominal
from labweb.domain.crutd.provenance.graph import Graph, redacted
from labweb.domain.crutd.provenance.lineage import Limits, Trace, trace_flows
from labweb.enrollment import selectors as enrollment_selectors
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab, Lot, Resource
from labweb.runs.models import Attempt, Job, Run
from labweb.runs.selectors import governed, visible_runs

DIRECTIONS = ("up", "down", "both")


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """A graph, and what is not in it."""

    lab: Lab
    record: Record
    graph: Graph
    beyond: int
    """Flows just behind the depth or the size."""

    unread: frozenset[str]
    """Vessels with too long a history."""

    has_more_acts: bool
    """There were more acts on the vessels than one answer holds."""

    locks: dict[str, frozenset[str]]
    """By job: the resources it used."""

    def truncation(self) -> dict[str, Any]:
        """Say what was left out, as plain data."""
        return {
            "is_truncated": bool(self.beyond or self.unread or self.has_more_acts),
            "beyond": self.beyond,
            "unread": sorted(self.unread),
            "has_more_acts": self.has_more_acts,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class _Seeds:
    """Where an answer begins."""

    root: str
    lab: Lab
    traces: Sequence[Trace]
    windows: Sequence[Window] = ()
    acts: Sequence[UUID] = ()
    jobs: Sequence[Job] = ()
    resources: Sequence[str] = ()
    lots: Sequence[str] = ()
    runs: Sequence[str] = ()
    files: Sequence[FileFact] = ()
    has_more: bool = False


def of_resource(resource: Resource, *, direction: str, depth: int) -> Provenance:
    """Return what led to what a resource is and holds, what it touched, or both."""
    traces = lineage.traces(resource, direction=direction, limits=_limits(depth))
    own = [] if direction == "down" else [(resource.id, 0, FOREVER)]
    return _answer(
        _Seeds(
            root=f"resource/{resource.id}",
            lab=resource.lab,
            traces=traces,
            windows=own,
            resources=[str(resource.id)],
        )
    )


def of_lot(lot: Lot, *, direction: str, depth: int) -> Provenance:
    """Return what was made from a lot; up, only how it came into the lab."""
    receipts = lineage.receipts_of(lot.id)
    if direction == "up":
        trace = Trace(flows=tuple(receipts))
    else:
        trace = trace_flows(receipts, lineage.history, _limits(depth), forward=True)
    return _answer(_Seeds(root=f"lot/{lot.id}", lab=lot.lab, traces=[trace], lots=[str(lot.id)]))


def of_run(run: Run, *, direction: str, depth: int, files: Sequence[FileFact] = ()) -> Provenance:
    """Return a run with all it did, and what that came from, became, or both."""
    tries = Attempt.objects.filter(job__run=run).order_by("at")
    acts = list(tries.values_list("transaction_id", flat=True)[: crutd.MOST_ACTS + 1])
    flows = lineage.flows_of(acts)
    ways = [way == "down" for way in ("up", "down") if direction in {way, "both"}]
    traces = [Trace(flows=tuple(flows))] + [
        trace_flows(flows, lineage.history, _limits(depth), forward=forward) for forward in ways
    ]
    jobs = list(Job.objects.filter(run=run).order_by("index")[: crutd.MOST_ACTS + 1])
    return _answer(
        _Seeds(
            root=f"run/{run.id}",
            lab=run.lab,
            traces=traces,
            acts=acts[: crutd.MOST_ACTS],
            jobs=jobs[: crutd.MOST_ACTS],
            runs=[str(run.id)],
            files=files,
            has_more=max(len(acts), len(jobs)) > crutd.MOST_ACTS,
        )
    )


def _limits(depth: int) -> Limits:
    return Limits(depth=depth, size=lineage.MOST_FLOWS)


def _answer(seeds: _Seeds) -> Provenance:
    flows = _joined(seeds.traces)
    windows = [*_windows(seeds.traces), *seeds.windows]
    acts, has_more = crutd.acts_within(windows)
    poured = {UUID(flow.activity) for flow in flows}
    transactions = crutd.transaction_facts({*poured, *acts, *seeds.acts})
    jobs = {job.pk: job for job in [*seeds.jobs, *_jobs_of(transactions)]}
    beside, has_more_beside = _beside({job.run_id for job in jobs.values()}, windows)
    known = {UUID(fact.id) for fact in transactions}
    transactions += crutd.transaction_facts(beside - known)
    jobs |= {job.pk: job for job in _jobs_of(transactions)}
    record = _record(seeds, flows, transactions, list(jobs.values()))
    return Provenance(
        lab=seeds.lab,
        record=record,
        graph=build_graph(record),
        beyond=sum(trace.beyond for trace in seeds.traces),
        unread=frozenset().union(*(trace.unread for trace in seeds.traces)),
        has_more_acts=has_more or has_more_beside or seeds.has_more,
        locks={str(job.pk): frozenset(job.locks) for job in jobs.values()},
    )


def _joined(traces: Iterable[Trace]) -> list[Flow]:
    found: dict[tuple[str, str, str], Flow] = {}
    for flow in (flow for trace in traces for flow in trace.flows):
        seen = found.get(flow.key, flow)
        found[flow.key] = replace(flow, lots={**seen.lots, **flow.lots})
    return sorted(found.values(), key=lambda flow: flow.order)


def _windows(traces: Iterable[Trace]) -> list[Window]:
    """Return when the matter was in each vessel, for the vessel and all it stands in now."""
    spans = {span for trace in traces for span in trace.spans}
    acts = {act for span in spans for act in (span.first, span.last) if act is not None}
    places = crutd.seqs(UUID(act) for act in acts)
    above = resource_selectors.ancestors({UUID(span.vessel) for span in spans})
    found: dict[UUID, list[tuple[int, int]]] = {}
    for span in spans:
        first = 0 if span.first is None else places.get(UUID(span.first), 0)
        last = FOREVER if span.last is None else places.get(UUID(span.last), FOREVER)
        vessel = UUID(span.vessel)
        for node in (vessel, *above[vessel]):
            found.setdefault(node, []).append((first, last))
    return [(node, *stay) for node, stays in sorted(found.items()) for stay in _merged(stays)]


def _merged(stays: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    """Join stays that overlap."""
    merged: list[tuple[int, int]] = []
    for first, last in sorted(stays):
        if merged and first <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(last, merged[-1][1]))
        else:
            merged.append((first, last))
    return merged


def _jobs_of(transactions: Iterable[TransactionFact]) -> list[Job]:
    ids = {fact.job_id for fact in transactions if fact.job_id}
    return list(Job.objects.filter(pk__in=ids))


def _beside(run_ids: Collection[UUID], windows: Collection[Window]) -> tuple[set[UUID], bool]:
    """Return what else these runs did with the vessels meanwhile: heated, stirred, measured."""
    stays: dict[str, list[tuple[int, int]]] = {}
    for resource, first, last in windows:
        stays.setdefault(str(resource), []).append((first, last))
    rows = Attempt.objects.filter(job__run_id__in=run_ids).exclude(
        job__operation__op__startswith="transfer"
    )
    tries = rows.order_by("at").values_list("transaction_id", "job__locks")
    found = list(tries[: crutd.MOST_ACTS + 1])
    places = crutd.seqs(act for act, _ in found)
    within = {
        act
        for act, locks in found[: crutd.MOST_ACTS]
        for node in locks
        for first, last in stays.get(node, ())
        if act in places and first <= places[act] <= last
    }
    return within, len(found) > crutd.MOST_ACTS


def _record(
    seeds: _Seeds,
    flows: Sequence[Flow],
    transactions: Sequence[TransactionFact],
    rows: Sequence[Job],
) -> Record:
    jobs = governed.job_facts(rows)
    run_ids = {job.run_id for job in jobs} | set(seeds.runs)
    runs = governed.run_facts(run_ids)
    decisions = governed.decision_facts(seeds.lab, run_ids)
    devices = governed.device_facts(seeds.lab, {job.device_id for job in jobs})
    nodes = {UUID(node) for device in devices for node in device.nodes}
    named = {*_resources(flows, transactions), *nodes, *map(UUID, seeds.resources)}
    lots = {lot for flow in flows for lot in flow.lots} | set(seeds.lots)
    return Record(
        root=seeds.root,
        flows=flows,
        transactions=transactions,
        jobs=jobs,
        runs=runs,
        decisions=decisions,
        devices=devices,
        resources=crutd.resource_facts(named),
        lots=crutd.lot_facts(lots),
        files=seeds.files,
        hosts=governed.host_names(seeds.lab),
        people=governed.people(_people(transactions, jobs, runs, decisions)),
        drivers=governed.drivers(jobs),
    )


def _resources(flows: Iterable[Flow], transactions: Iterable[TransactionFact]) -> Iterator[UUID]:
    for flow in flows:
        yield from (UUID(end) for end in (flow.source, flow.target) if not is_nominal(end))
    for fact in transactions:
        for key, value in fact.operation.items():
            if key.endswith("_id") and isinstance(value, str) and value:
                yield UUID(value)


def _people(
    transactions: Iterable[TransactionFact],
    jobs: Iterable[JobFact],
    runs: Iterable[RunFact],
    decisions: Iterable[DecisionFact],
) -> Iterator[str]:
    yield from (fact.actor_id for fact in transactions)
    yield from (fact.resolved_by for fact in jobs)
    yield from (fact.actor_id for fact in decisions)
    for run in runs:
        yield from (run.created_by_id, run.version_author_id)


def seen_by(found: Provenance, seen: Collection[UUID]) -> Graph:
    """Return the graph as somebody may know it: what is outside keeps its form, not its words.

    Args:
        found: The whole.
        seen: Resources that they may know of.
    """
    shown = {str(node) for node in seen}
    runs = {str(pk) for pk in visible_runs(found.lab, seen).values_list("pk", flat=True)}
    record = found.record
    jobs = {job.id for job in record.jobs if not found.locks[job.id] <= shown}
    hidden = {f"resource/{fact.id}" for fact in record.resources if fact.id not in shown}
    hidden |= {
        n for n in found.graph.nodes if n.startswith("state/") and n.split("/")[1] not in shown
    }
    hidden |= {f"job/{job}" for job in jobs}
    hidden |= {f"reading/{fact.id}" for fact in record.transactions if fact.job_id in jobs}
    for run in record.runs:
        if run.id not in runs:
            hidden |= {f"run/{run.id}", f"plan/{run.id}", f"version/{run.version_id}"}
    hidden |= {f"decision/{fact.id}" for fact in record.decisions if fact.run_id not in runs}
    devices = enrollment_selectors.visible_devices(found.lab, seen)
    known = {str(device.pk) for device in devices}
    hidden |= {f"device/{fact.id}" for fact in record.devices if fact.id not in known}
    return redacted(found.graph, hidden | _only_with(found.graph, hidden))


def shown_runs(ids: Collection[str], user: User) -> set[str]:
    """Return which of the runs the user may see."""
    seen = resource_selectors.allowed_ids(user, Permission.VIEW)
    rows = visible_runs(resource_selectors.the_lab(), seen).filter(pk__in=list(ids))
    return {str(pk) for pk in rows.values_list("pk", flat=True)}


def _only_with(graph: Graph, hidden: Collection[str]) -> set[str]:
    """Return the people and drivers of whom nothing but what is hidden tells."""
    told: dict[str, bool] = {}
    for relation in graph.relations:
        for one, other in (
            (relation.later, relation.third or relation.earlier),
            (relation.earlier, relation.third or relation.later),
        ):
            if one.startswith(("user/", "driver/")):
                told[one] = told.get(one, False) or other not in hidden
    return {name for name, is_told in told.items() if not is_told}
