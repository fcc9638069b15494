"""From the record to one graph.

| ours | PROV |
|---|---|
| Resource, Lot, Reading, WorkflowVersion, Plan, driver source, file | entity |
| Transaction, Job, Run, Decision, Measurement | activity |
| User; EdgeHost; Device | agent: person; software; agent |
| Create | `wasGeneratedBy` |
| Read | `used`, and a reading that `wasGeneratedBy` it |
| Measurement | `used` with role measured; a file it generated, readings derived from the file |
| Update | a new state, revision of the one before, special case of the resource |
| Transfer | `used` with role source, a new state with role target, derived; `atLocation` |
| Delete | `wasInvalidatedBy`; the resource is kept in the Archive |
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from labweb.domain.crutd.provenance.ledger_flows import LedgerFlow, is_nominal, is_reaction
from labweb.domain.crutd.provenance.measurement_files import measurement
from labweb.domain.crutd.provenance.provenance_graph import (
    Bond,
    Fact,
    ProvGraph,
    ProvKind,
    ProvNode,
    Relation,
    make_graph,
)
from labweb.domain.crutd.provenance.recorded_facts import (
    JobFact,
    MeasurementFact,
    RecordedFacts,
    ResourceFact,
    TransactionFact,
)
from labweb.domain.crutd.provenance.responsible_agents import governed
from labweb.domain.crutd.transaction_states import TransactionState

_LONGEST_FACT = 500


def build_graph(record: RecordedFacts) -> ProvGraph:
    """Bring transactions, jobs, runs, decisions, people and devices into one graph.

    Resources that the record names and does not describe are left out with what binds them.
    """
    builder = _Builder(record)
    left = sorted(record.measurements, key=lambda m: (m.seq, m.id), reverse=True)
    for fact in sorted(record.transactions, key=lambda t: (t.seq, t.id)):
        while left and left[-1].seq < fact.seq:
            builder.measured(left.pop())
        builder.transaction(fact)
    for later in reversed(left):
        builder.measured(later)
    nodes, relations = governed(record, {node.id for node in builder.nodes.values()})
    builder.nodes.update({node.id: node for node in nodes})
    return make_graph(record.root, builder.nodes.values(), [*builder.relations, *relations])


class _Builder:
    """Carries the state that each resource is in, from one transaction to the next."""

    def __init__(self, record: RecordedFacts) -> None:
        self.record = record
        self.nodes: dict[str, ProvNode] = {}
        self.relations: list[Relation] = []
        self._resources = {r.id: r for r in record.resources}
        self._jobs = {job.id: job for job in record.jobs}
        self._devices = {device.id: device for device in record.devices}
        self._flows: dict[str, list[LedgerFlow]] = {}
        for flow in record.flows:
            self._flows.setdefault(flow.activity, []).append(flow)
        self._now: dict[str, str] = {}
        for resource in record.resources:
            self._add_resource(resource)
        for lot in record.lots:
            facts = {"material": lot.material, "number": lot.number, "supplier": lot.supplier}
            self._add(
                f"lot/{lot.id}",
                ProvKind.ENTITY,
                "lot",
                lot.name,
                {**facts, "expires": lot.expires_on},
            )

    def _add_resource(self, fact: ResourceFact) -> None:
        self._add(
            f"resource/{fact.id}", ProvKind.ENTITY, "resource", fact.name, {"kind": fact.kind}
        )
        if fact.collection_id in self._resources:
            self._bind(Bond.MEMBER, f"resource/{fact.collection_id}", f"resource/{fact.id}")

    def _add(
        self,
        name: str,
        kind: ProvKind,
        sort: str,
        label: str,
        facts: Mapping[str, Fact] | None = None,
    ) -> None:
        kept = {key: value for key, value in (facts or {}).items() if value != ""}
        self.nodes[name] = ProvNode(id=name, kind=kind, type=sort, name=label, facts=kept)

    def _bind(self, bond: Bond, later: str, earlier: str, **more: Any) -> None:  # noqa: ANN401
        self.relations.append(Relation(bond=bond, later=later, earlier=earlier, **more))

    def measured(self, fact: MeasurementFact) -> None:
        """Add a measurement of the state that a resource is in, with its files and readings."""
        nodes, relations = measurement(fact)
        self.nodes.update({node.id: node for node in nodes})
        self.relations += relations
        self._use(f"measurement/{fact.id}", fact.resource_id, "measured", "")

    def transaction(self, fact: TransactionFact) -> None:
        """Add one transaction with the states it took and left."""
        name = f"transaction/{fact.id}"
        facts: dict[str, Fact] = {
            "state": fact.state,
            "verification": fact.verification,
            "code": fact.code,
            "event_seq": fact.seq,
            "event_hash": fact.event_hash,
            "doubt_at": fact.doubt_at,
            "resolved": fact.resolved,
        }
        self.nodes[name] = ProvNode(
            id=name,
            kind=ProvKind.ACTIVITY,
            type="transaction",
            name=fact.name,
            started_at=fact.started_at,
            ended_at=fact.ended_at,
            facts={key: value for key, value in facts.items() if value != ""},
        )
        flows = self._flows.get(fact.id, [])
        if flows:
            self._matter(fact, name, flows)
        elif fact.state == TransactionState.COMMITTED.value:
            self._operation(fact, name)
        else:
            for resource in _named(fact.operation):
                self._use(name, resource, "", fact.started_at)

    def _matter(self, fact: TransactionFact, name: str, flows: Iterable[LedgerFlow]) -> None:
        """Add what was poured: all sources as they were before, then all states after."""
        before = dict(self._now)
        after: dict[str, str] = {}
        for flow in flows:
            moved = _amounts(flow)
            source = self._source(name, flow, before, after, fact)
            if flow.target in self._resources:
                state = self._state(fact, flow.target, after)
                role = "target"
                self._bind(Bond.GENERATED, state, name, role=role, at=fact.ended_at, facts=moved)
                for origin in source:
                    if origin != state:
                        self._bind(Bond.DERIVED, state, origin, facts=moved)
        self._now.update(after)

    def _source(
        self,
        name: str,
        flow: LedgerFlow,
        before: Mapping[str, str],
        after: dict[str, str],
        fact: TransactionFact,
    ) -> list[str]:
        """Bind where a flow came from; return the entities that its target is derived from."""
        moved = _amounts(flow)
        lots = [f"lot/{lot}" for lot in flow.lots if f"lot/{lot}" in self.nodes]
        if is_reaction(flow.source):
            for lot in lots:
                self._bind(Bond.GENERATED, lot, name, role="product", at=fact.ended_at)
                for reactant in self._reactants(fact.id):
                    self._bind(Bond.DERIVED, lot, reactant)
            return lots
        if is_nominal(flow.source):
            for lot in lots:
                self._bind(Bond.USED, name, lot, role="received", at=fact.started_at)
            return lots
        if flow.source not in self._resources:
            return []
        used = before.get(flow.source, f"resource/{flow.source}")
        self._bind(Bond.USED, name, used, role="source", at=fact.started_at, facts=moved)
        state = self._state(fact, flow.source, after)
        self._bind(Bond.GENERATED, state, name, role="source", at=fact.ended_at)
        return [used]

    def _reactants(self, activity: str) -> list[str]:
        flows = (flow for flow in self._flows[activity] if is_reaction(flow.target))
        lots = {f"lot/{lot}" for flow in flows for lot in flow.lots}
        return sorted(lots & self.nodes.keys())

    def _state(self, fact: TransactionFact, resource: str, after: dict[str, str]) -> str:
        """Add the state that a transaction leaves a resource in; once per transaction."""
        if resource in after:
            return after[resource]
        label = f"{self._resources[resource].name} after #{fact.seq}"
        state = f"state/{resource}/{fact.seq}" if fact.seq else f"state/{resource}/{fact.id}"
        self._add(state, ProvKind.ENTITY, "state", label)
        self._bind(Bond.SPECIAL_CASE, state, f"resource/{resource}")
        last = self._now.get(resource)
        if last is not None:
            self._bind(Bond.DERIVED, state, last, is_revision=True)
        after[resource] = state
        return state

    def _use(self, name: str, resource: str, role: str, at: str) -> None:
        if resource in self._resources:
            used = self._now.get(resource, f"resource/{resource}")
            self._bind(Bond.USED, name, used, role=role, at=at)

    def _operation(self, fact: TransactionFact, name: str) -> None:
        operation = fact.operation
        match operation.get("op"):
            case "update":
                self._update(fact, name, str(operation["resource_id"]))
            case "transfer_resource":
                self._carry(fact, name, operation)
            case "read":
                self._read(fact, name, str(operation["device_id"]))
            case "create":
                self._create(fact, name)
            case "refit":
                self._refit(fact, name, operation)
            case "delete":
                resource = str(operation["resource_id"])
                self._use(name, str(operation["archive_id"]), "archive", fact.started_at)
                if resource in self._resources:
                    entity = self._now.get(resource, f"resource/{resource}")
                    self._bind(Bond.INVALIDATED, entity, name, at=fact.ended_at)
            case _:
                for resource in _named(operation):
                    self._use(name, resource, "", fact.started_at)

    def _update(self, fact: TransactionFact, name: str, resource: str) -> None:
        if resource not in self._resources:
            return
        self._use(name, resource, "", fact.started_at)
        state = self._state(fact, resource, {})
        data = (fact.change.get("data") or {}).get(resource) or fact.operation.get("data") or {}
        label = self.nodes[state].name
        self._add(state, ProvKind.ENTITY, "state", label, _facts(data))
        self._bind(Bond.GENERATED, state, name, at=fact.ended_at)
        self._now[resource] = state

    def _carry(self, fact: TransactionFact, name: str, operation: Mapping[str, Any]) -> None:
        moved, to = str(operation["resource_id"]), str(operation["to_id"])
        self._use(name, moved, "subject", fact.started_at)
        self._use(name, str(operation["from_id"]), "source", fact.started_at)
        self._use(name, to, "target", fact.started_at)
        if moved not in self._resources:
            return
        state = self._state(fact, moved, {})
        self._bind(Bond.GENERATED, state, name, at=fact.ended_at)
        if to in self._resources:
            self.nodes[state] = replace(self.nodes[state], place=f"resource/{to}")
        self._now[moved] = state

    def _create(self, fact: TransactionFact, name: str) -> None:
        for resource in _created(fact):
            if resource in self._resources:
                self._bind(Bond.GENERATED, f"resource/{resource}", name, at=fact.ended_at)

    def _refit(self, fact: TransactionFact, name: str, operation: Mapping[str, Any]) -> None:
        """Bind parts of a device that came, went or became otherwise with its driver's version."""
        if fact.change.get("state") != "committed":
            return
        for resource in map(str, operation.get("gone", ())):
            if resource in self._resources:
                entity = self._now.get(resource, f"resource/{resource}")
                self._bind(Bond.INVALIDATED, entity, name, at=fact.ended_at)
        self._create(fact, name)
        changed = {**operation.get("back", {}), **operation.get("configs", {})}
        for resource in sorted(map(str, changed)):
            if resource in self._resources:
                self._use(name, resource, "", fact.started_at)
                state = self._state(fact, resource, {})
                self._bind(Bond.GENERATED, state, name, at=fact.ended_at)
                self._now[resource] = state

    def _read(self, fact: TransactionFact, name: str, device: str) -> None:
        job = self._jobs.get(fact.job_id)
        known = self._devices.get(device)
        for node in known.nodes if known is not None else ():
            self._use(name, node, "", fact.started_at)
        if job is None:
            return
        reading = f"reading/{fact.id}"
        self._add(reading, ProvKind.ENTITY, "reading", job.sentence, reported(job))
        self._bind(Bond.GENERATED, reading, name, at=fact.ended_at)


def _amounts(flow: LedgerFlow) -> dict[str, Fact]:
    found = {"amount_nl": flow.amount_nl, "amount_ug": flow.amount_ug}
    return {unit: amount for unit, amount in found.items() if amount}


def _named(operation: Mapping[str, Any]) -> list[str]:
    """Return the resources that an operation names."""
    ids = [str(value) for key, value in operation.items() if key.endswith("_id") and value]
    return sorted(set(ids))


def _created(fact: TransactionFact) -> list[str]:
    told = fact.change.get("created") or [fact.operation.get("resource_id", "")]
    return [str(resource) for resource in told if resource]


def reported(job: JobFact) -> dict[str, Fact]:
    """Return what a device reported with a job, as facts."""
    report = {key: value for key, value in job.report.items() if key != "ok"}
    inner = report.pop("data", None)
    return _facts({**report, **(inner if isinstance(inner, dict) else {})})


def _facts(data: Mapping[str, Any]) -> dict[str, Fact]:
    """Return JSON as facts: what is no plain value is written as JSON."""
    found: dict[str, Fact] = {}
    for key, value in data.items():
        if isinstance(value, bool | int | float | str):
            found[key] = value[:_LONGEST_FACT] if isinstance(value, str) else value
        else:
            found[key] = json.dumps(value, ensure_ascii=False, sort_keys=True)[:_LONGEST_FACT]
    return found
