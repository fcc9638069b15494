"""Questions that tests put to the compiler, and how they read its answers."""

from __future__ import annotations

from typing import Any

import pytest

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.errors import Finding, InfeasibleError, LabError, ProtocolError
from labweb.domain.workflows.compile_workflow import compile_workflow
from labweb.domain.workflows.plan import Plan, PlannedJob
from labweb.domain.workflows.workflow_file import Workflow, parse_workflow, resolve_keys
from tests.domain.workflows.bench import (
    Bench,
    id_of,
)


def read(bench: Bench, value: dict[str, Any]) -> Workflow:
    return resolve_keys(parse_workflow(value), bench.tree)


def plan_of(bench: Bench, value: dict[str, Any]) -> Plan:
    return compile_workflow(read(bench, value), bench.view())


def findings_of(bench: Bench, value: dict[str, Any]) -> tuple[Finding, ...]:
    with pytest.raises(LabError) as caught:
        plan_of(bench, value)
    assert isinstance(caught.value, InfeasibleError | ProtocolError)
    assert caught.value.code == caught.value.findings[0].code
    return caught.value.findings


def codes_of(bench: Bench, value: dict[str, Any]) -> list[tuple[str, str]]:
    return [(finding.subject, finding.code) for finding in findings_of(bench, value)]


def actions(plan: Plan) -> list[str]:
    return [job.action for job in plan.jobs]


def moved_nl(plan: Plan, source: str, target: str) -> int:
    ends = (id_of(source), id_of(target))
    return sum(
        job.operation.amount_nl
        for job in plan.jobs
        if isinstance(job.operation, TransferLiquid)
        and (job.operation.source_id, job.operation.target_id) == ends
    )


def the_job(plan: Plan, action: str) -> PlannedJob:
    (job,) = [job for job in plan.jobs if job.action == action]
    return job
