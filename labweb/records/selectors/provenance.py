"""All that led to a thing and all that it touched, as one graph."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any
from uuid import UUID

from labweb.crutd.selectors import lineage
from labweb.crutd.selectors import provenance as crutd
from labweb.crutd.selectors.provenance import FOREVER, Window
from labweb.domain.crutd.provenance.graph_from_record import build_graph
from labweb.domain.crutd.provenance.ledger_flows import LedgerFlow, is_nominal, is_reaction
from labweb.domain.crutd.provenance.lineage import Limits, Trace, trace_flows
from labweb.domain.crutd.provenance.provenance_graph import ProvGraph
from labweb.domain.crutd.provenance.recorded_facts import (
    DecisionFact,
    FileFact,
    JobFact,
    RecordedFacts,
    RunFact,
    TransactionFact,
)
from labweb.domain.resources.resource_kinds import is_vessel
from labweb.records.selectors import activity_facts, measurement_facts
from labweb.records.selectors.measurement_facts import Measured
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab, Lot, Resource
from labweb.runs.selectors import Attempt, Job, Run
from labweb.telemetry.selectors import File, Reading

DIRECTIONS = ("both", "up", "down")


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """A graph, and what is not in it."""

    lab: Lab
    record: RecordedFacts
    graph: ProvGraph
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
    watched: Sequence[Window] = ()
    """When what was measured of a resource counts, beside the windows."""

    acts: Sequence[UUID] = ()
    jobs: Sequence[Job] = ()
    resources: Sequence[str] = ()
    lots: Sequence[str] = ()
    runs: Sequence[str] = ()
    files: Sequence[FileFact] = ()
    measured: Sequence[UUID] = ()
    """Kept files that belong to the answer whatever else does."""

    until: int = FOREVER
    """Place in the chain after which nothing counts."""

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
            watched=[(resource.id, 0, FOREVER)],
            resources=[str(resource.id)],
        )
    )


def of_lot(lot: Lot, *, direction: str, depth: int) -> Provenance:
    """Return what was made from a lot; up, how it came into the lab, or what it was made of."""
    receipts = lineage.receipts_of(lot.id)
    traces = [Trace(flows=tuple(receipts))]
    if direction != "down":
        made = [UUID(flow.activity) for flow in receipts if is_reaction(flow.source)]
        consumed = [flow for flow in lineage.flows_of(made) if is_reaction(flow.target)]
        traces.append(trace_flows(consumed, lineage.history, _limits(depth), forward=False))
    if direction != "up":
        traces.append(trace_flows(receipts, lineage.history, _limits(depth), forward=True))
    return _answer(_Seeds(root=f"lot/{lot.id}", lab=lot.lab, traces=traces, lots=[str(lot.id)]))


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


def of_file(row: File, *, direction: str, depth: int) -> Provenance:
    """Return what a kept file is of, with all that had led to it; down, what was read from it."""
    return _answer(_file_seeds(row, f"file/{row.pk}", direction=direction, depth=depth))


def of_reading(row: Reading, *, direction: str, depth: int) -> Provenance:
    """Return the file that a reading is from, and what the file is of with all that led to it."""
    seeds = _file_seeds(row.file, f"reading/{row.pk}", direction=direction, depth=depth)
    return _answer(seeds, reading=str(row.pk))


def _file_seeds(row: File, root: str, *, direction: str, depth: int) -> _Seeds:
    moment = measurement_facts.moments(row.lab, [row])[row.pk]
    resource = row.resource_id
    if direction == "down":
        named = [] if resource is None else [str(resource)]
        return _Seeds(root=root, lab=row.lab, traces=[], resources=named, measured=[row.pk])
    jobs = [] if row.job_id is None else list(Job.objects.filter(pk=row.job_id))
    held = {UUID(node) for job in jobs for node in job.locks} if resource is None else {resource}
    kinds = dict(resource_selectors.rows(held).values_list("id", "kind"))
    vessels = sorted(node for node, kind in kinds.items() if is_vessel(kind))
    acts = Attempt.objects.filter(job__in=[job.pk for job in jobs])
    return _Seeds(
        root=root,
        lab=row.lab,
        traces=lineage.traces_until(vessels, moment.at, _limits(depth)),
        windows=[] if resource is None else [(resource, 0, moment.seq)],
        acts=list(acts.values_list("transaction_id", flat=True)),
        jobs=jobs,
        resources=[str(node) for node in sorted(held)],
        measured=[row.pk],
        until=moment.seq,
    )


def _limits(depth: int) -> Limits:
    return Limits(depth=depth, size=lineage.MOST_FLOWS)


def _answer(seeds: _Seeds, *, reading: str = "") -> Provenance:
    flows = _joined(seeds.traces)
    windows = [
        (node, first, min(last, seeds.until))
        for node, first, last in [*_windows(seeds.traces), *seeds.windows]
    ]
    acts, has_more = crutd.acts_within(windows)
    poured = {UUID(flow.activity) for flow in flows}
    transactions = crutd.transaction_facts({*poured, *acts, *seeds.acts})
    jobs = {job.pk: job for job in [*seeds.jobs, *_jobs_of(transactions)]}
    beside, has_more_beside = _beside({job.run_id for job in jobs.values()}, windows)
    known = {UUID(fact.id) for fact in transactions}
    transactions += crutd.transaction_facts(beside - known)
    jobs |= {job.pk: job for job in _jobs_of(transactions)}
    found = _measured(seeds, windows, jobs, reading)
    jobs |= _named_jobs(found, jobs)
    record = _record(seeds, flows, transactions, list(jobs.values()), found)
    return Provenance(
        lab=seeds.lab,
        record=record,
        graph=build_graph(record),
        beyond=sum(trace.beyond for trace in seeds.traces),
        unread=frozenset().union(*(trace.unread for trace in seeds.traces)),
        has_more_acts=has_more or has_more_beside or seeds.has_more or found.has_more,
        locks={str(job.pk): frozenset(job.locks) for job in jobs.values()},
    )


def _measured(
    seeds: _Seeds, windows: Sequence[Window], jobs: Collection[UUID], reading: str
) -> Measured:
    """Return what was measured meanwhile; of a file alone, that file."""
    if seeds.measured:
        found = measurement_facts.within(seeds.lab, [], (), seeds.measured)
        return found.only(reading) if reading else found
    return measurement_facts.within(seeds.lab, [*windows, *seeds.watched], jobs)


def _named_jobs(found: Measured, known: Collection[UUID]) -> dict[UUID, Job]:
    ids = {UUID(fact.job_id) for fact in found.facts if fact.job_id} - set(known)
    return {job.pk: job for job in Job.objects.filter(pk__in=ids)} if ids else {}


def _joined(traces: Iterable[Trace]) -> list[LedgerFlow]:
    found: dict[tuple[str, str, str], LedgerFlow] = {}
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
    flows: Sequence[LedgerFlow],
    transactions: Sequence[TransactionFact],
    rows: Sequence[Job],
    found: Measured,
) -> RecordedFacts:
    jobs = activity_facts.job_facts(rows)
    run_ids = {job.run_id for job in jobs} | set(seeds.runs)
    runs = activity_facts.run_facts(run_ids)
    decisions = activity_facts.decision_facts(seeds.lab, run_ids)
    told = {fact.device_id for fact in found.facts if fact.device_id}
    devices = activity_facts.device_facts(seeds.lab, {job.device_id for job in jobs} | told)
    nodes = {UUID(node) for device in devices for node in device.nodes}
    subjects = {UUID(fact.resource_id) for fact in found.facts if fact.resource_id}
    named = {*_resources(flows, transactions), *nodes, *map(UUID, seeds.resources), *subjects}
    lots = {lot for flow in flows for lot in flow.lots} | set(seeds.lots)
    return RecordedFacts(
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
        measurements=found.facts,
        hosts=activity_facts.host_names(seeds.lab),
        people=activity_facts.people(
            [*_people(transactions, jobs, runs, decisions), *(f.kept_by_id for f in found.facts)]
        ),
        drivers=activity_facts.drivers(jobs),
    )


def _resources(
    flows: Iterable[LedgerFlow], transactions: Iterable[TransactionFact]
) -> Iterator[UUID]:
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
