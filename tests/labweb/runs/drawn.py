"""Runs of workflows that a test draws: its steps one behind the other."""

from __future__ import annotations

from typing import Any
from uuid import uuid4

from labweb.runs import services
from labweb.runs.models import Run
from labweb.workflows.models import WorkflowVersion
from tests.builders import MOVE_WATER, Bench


def a_version(
    bench: Bench,
    *steps: tuple[str, dict[str, Any]],
    **more: Any,  # noqa: ANN401 - as in the document
) -> WorkflowVersion:
    """Save a workflow of these steps, each behind the one before it."""
    known = bench.version(MOVE_WATER)
    rows = [
        {"id": f"s{n}", "kind": kind, "params": params, "position": {"x": 0, "y": 0}}
        for n, (kind, params) in enumerate(steps)
    ]
    edges = [
        {"id": f"e{n}", "source": f"s{n}", "source_port": "done"}
        | {"target": f"s{n + 1}", "target_port": "start"}
        for n in range(len(rows) - 1)
    ]
    whole = {"schema": "labweb.workflow/1", "name": "Drawn", "steps": rows, "edges": edges, **more}
    return WorkflowVersion.objects.create(
        id=uuid4(),
        workflow=known.workflow,
        number=99,
        document=whole,
        author=known.author,
        at=known.at,
        digest=known.digest,
    )


def a_run(bench: Bench, *steps: tuple[str, dict[str, Any]], **more: Any) -> Run:  # noqa: ANN401
    """Start such a workflow in the name of the chemist."""
    version = a_version(bench, *steps, **more)
    return services.start_run(version, actor=bench.people["chemist"])
