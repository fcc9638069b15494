"""Who and what stands behind transactions: jobs, runs, plans, decisions, people, devices."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from labweb.domain.crutd.provenance.provenance_graph import Bond, Fact, ProvKind, ProvNode, Relation
from labweb.domain.crutd.provenance.recorded_facts import (
    DecisionFact,
    FileFact,
    JobFact,
    MeasurementFact,
    RecordedFacts,
    RunFact,
    TransactionFact,
)


def governed(
    record: RecordedFacts, known: Collection[str]
) -> tuple[list[ProvNode], list[Relation]]:
    """Return the nodes and relations of jobs, runs and decisions, and of whoever bears them.

    Args:
        record: What is on record.
        known: Ids of the nodes that are there already.
    """
    found = _Governed(record, known)
    for run in record.runs:
        found.run(run)
    for decision in record.decisions:
        found.decision(decision)
    for job in record.jobs:
        found.job(job)
    for transaction in record.transactions:
        found.borne(transaction)
    for measurement in record.measurements:
        found.measured(measurement)
    for file in record.files:
        found.file(file)
    return list(found.nodes.values()), found.relations


_MOMENTS = {"started": "started", "actuated": "was answered"}


def _plain(value: Any) -> Fact:  # noqa: ANN401 - any JSON
    return value if isinstance(value, bool | int | float | str) else ""


def _aged(reading: Mapping[str, Any]) -> str:
    return f"{reading['value']}, {reading['age_s']:g} s old"


class _Governed:
    def __init__(self, record: RecordedFacts, known: Collection[str]) -> None:
        self._record = record
        self._known = frozenset(known)
        self._devices = {device.id: device for device in record.devices}
        self._runs = {run.id: run for run in record.runs}
        self._jobs = {job.id: job for job in record.jobs}
        self.nodes: dict[str, ProvNode] = {}
        self.relations: list[Relation] = []

    def _bind(
        self, bond: Bond, later: str, earlier: str, *, role: str = "", at: str = "", third: str = ""
    ) -> None:
        if later and earlier:
            relation = Relation(
                bond=bond, later=later, earlier=earlier, role=role, at=at, third=third
            )
            self.relations.append(relation)

    def _person(self, user_id: str) -> str:
        name = self._record.people.get(user_id)
        if name is None:
            return ""
        return self._agent(f"user/{user_id}", "user", name)

    def _host(self, host_id: str) -> str:
        name = self._record.hosts.get(host_id)
        return "" if name is None else self._agent(f"host/{host_id}", "host", name)

    def _device(self, device_id: str) -> str:
        device = self._devices.get(device_id)
        return "" if device is None else self._agent(f"device/{device_id}", "device", device.name)

    def _agent(self, name: str, sort: str, label: str) -> str:
        self.nodes[name] = ProvNode(id=name, kind=ProvKind.AGENT, type=sort, name=label)
        return name

    def _entity(self, name: str, sort: str, label: str, **facts: Fact) -> str:
        self.nodes[name] = ProvNode(
            id=name, kind=ProvKind.ENTITY, type=sort, name=label, facts=facts
        )
        return name

    def run(self, run: RunFact) -> None:
        """Add a run with its plan, and the version that the plan was compiled from."""
        name = f"run/{run.id}"
        self.nodes[name] = ProvNode(
            id=name,
            kind=ProvKind.ACTIVITY,
            type="run",
            name=f"Run #{run.number}",
            started_at=run.started_at,
            ended_at=run.ended_at,
            facts={"state": run.state, "workflow": run.workflow},
        )
        label = f"{run.workflow} v{run.version_number}"
        version = self._entity(
            f"version/{run.version_id}",
            "workflow_version",
            label,
            digest=run.version_digest,
            saved_at=run.version_at,
        )
        plan = self._entity(
            f"plan/{run.id}", "plan", f"Plan of run #{run.number}", digest=run.plan_digest
        )
        self._bind(Bond.DERIVED, plan, version)
        self._bind(Bond.ATTRIBUTED, version, self._person(run.version_author_id))
        self._bind(Bond.USED, name, plan, at=run.started_at)
        self._bind(Bond.ASSOCIATED, name, self._person(run.created_by_id), third=plan)

    def decision(self, decision: DecisionFact) -> None:
        """Add a person's decision, of which the run was informed."""
        if decision.run_id not in self._runs:
            return
        name = f"decision/{decision.id}"
        self.nodes[name] = ProvNode(
            id=name,
            kind=ProvKind.ACTIVITY,
            type="decision",
            name=decision.meaning,
            started_at=decision.at,
            ended_at=decision.at,
            facts={"is_approved": decision.is_approved},
        )
        self._bind(Bond.USED, name, f"plan/{decision.run_id}", at=decision.at)
        self._bind(Bond.ASSOCIATED, name, self._person(decision.actor_id), role="approver")
        self._bind(Bond.INFORMED, f"run/{decision.run_id}", name)

    def job(self, job: JobFact) -> None:
        """Add a job, the device that did it, for whom, and by which source of its driver."""
        name = f"job/{job.id}"
        facts: dict[str, Fact] = {
            "action": job.action,
            "index": job.index,
            "state": job.state,
            "verification": job.verification,
        }
        if job.worker_pid is not None:
            facts["worker_pid"] = job.worker_pid
        self.nodes[name] = ProvNode(
            id=name,
            kind=ProvKind.ACTIVITY,
            type="job",
            name=job.sentence,
            started_at=job.started_at,
            ended_at=job.ended_at,
            facts={key: value for key, value in facts.items() if value != ""},
        )
        run = self._runs.get(job.run_id)
        device, host = self._device(job.device_id), self._host(job.host_id)
        plan = "" if run is None else f"plan/{run.id}"
        self._bind(Bond.ASSOCIATED, name, device, third=plan)
        self._bind(Bond.ON_BEHALF, device, host, third=name)
        if run is not None:
            self._bind(Bond.INFORMED, name, f"run/{run.id}")
            self._bind(Bond.ON_BEHALF, host, self._person(run.created_by_id), third=name)
        if job.driver_digest:
            label = self._record.drivers.get(job.driver_digest, "driver")
            entity = f"driver/{job.driver_digest}"
            driver = self._entity(entity, "driver_version", label, digest=job.driver_digest)
            self._bind(Bond.USED, name, driver, role="driver", at=job.started_at)
        self._bind(Bond.ASSOCIATED, name, self._person(job.resolved_by), role="resolver")
        for moment, context in job.contexts.items():
            self._context(name, moment, context)

    def _context(self, job: str, moment: str, context: Mapping[str, Any]) -> None:
        """Add the settings and the surroundings that a job met at its start or its answer."""
        digest = str(context["config_digest"])
        calibration = {f"calibration {k}": _plain(v) for k, v in context["calibration"].items()}
        label = "Settings of the device"
        config = self._entity(
            f"config/{digest}", "device_settings", label, digest=digest, **calibration
        )
        self._bind(Bond.USED, job, config, role=f"settings_{moment}")
        readings = context["environment"]
        if not readings:
            return
        told = {}
        for reading in readings:
            device = self._devices.get(reading["device_id"])
            name = reading["device_id"] if device is None else device.name
            told[f"{name}: {reading['status']}"] = _aged(reading)
        surroundings = self._entity(
            f"surroundings/{job.removeprefix('job/')}/{moment}",
            "surroundings",
            f"Latest readings when it {_MOMENTS[moment]}",
            **told,
        )
        self._bind(Bond.USED, job, surroundings, role=f"surroundings_{moment}")

    def borne(self, fact: TransactionFact) -> None:
        """Bind a transaction to its job, or to the person who did it by hand."""
        name = f"transaction/{fact.id}"
        job = self._jobs.get(fact.job_id)
        if job is None:
            self._bind(Bond.ASSOCIATED, name, self._person(fact.actor_id))
            return
        self._bind(Bond.INFORMED, name, f"job/{job.id}")
        device = self._device(job.device_id)
        self._bind(Bond.ASSOCIATED, name, device)
        reading = f"reading/{fact.id}"
        if reading in self._known:
            self._bind(Bond.ATTRIBUTED, reading, device)

    def measured(self, fact: MeasurementFact) -> None:
        """Bind a measurement to its job, its device, and the person who brought the file."""
        name = f"measurement/{fact.id}"
        if fact.job_id in self._jobs:
            self._bind(Bond.INFORMED, name, f"job/{fact.job_id}")
        device = self._device(fact.device_id)
        self._bind(Bond.ASSOCIATED, name, device)
        self._bind(Bond.ATTRIBUTED, f"file/{fact.id}", device)
        self._bind(Bond.ASSOCIATED, name, self._person(fact.kept_by_id), role="keeper")

    def file(self, file: FileFact) -> None:
        """Add a file that a run left; a kept one goes by where it lies."""
        name = f"file/{file.id or file.sha256}"
        is_known = name in self._known
        entity = self._entity(
            name,
            "file",
            file.name,
            media_type=file.media_type,
            size_bytes=file.size_bytes,
            sha256=file.sha256,
        )
        if file.run_id in self._runs and not is_known:
            self._bind(Bond.GENERATED, entity, f"run/{file.run_id}")
