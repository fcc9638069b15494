"""A lab file, as the compiler sees it and as its interpreter does."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import msgspec

from labweb.domain.crutd.settlement import ResourceState
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.errors import Finding, LabError
from labweb.domain.graph.lab_file.lab_json_write import render_lab
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.workflows.compile_workflow import PlannerView, compile_workflow
from labweb.domain.workflows.plan import encode
from labweb.domain.workflows.workflow_file import parse_workflow
from tests.acceptance.interpreter import Wanted
from tests.acceptance.plumbing import Plumbing


@cache
def catalog() -> dict[str, DriverSpec]:
    """Return every driver of the package by `module:Class`."""
    told = subprocess.run(
        [sys.executable, "-m", "drivers.catalog", "--json"], capture_output=True, check=True
    )
    specs = msgspec.convert(json.loads(told.stdout)["drivers"], list[DriverSpec])
    return {f"{spec.module}:{spec.class_name}": spec for spec in specs}


@dataclass(frozen=True)
class Subject:
    """One lab under test."""

    lab: LabFile

    @cached_property
    def file(self) -> dict[str, Any]:
        """The lab as its file has it."""
        return dict(json.loads(render_lab(self.lab)))

    @cached_property
    def plumbing(self) -> Plumbing:
        return Plumbing(self.file)

    @cached_property
    def ids(self) -> dict[str, str]:
        """Id by key of each resource."""
        return {resource.key: str(resource.id) for resource in self.lab.resources}

    @cached_property
    def keys(self) -> dict[str, str]:
        """Key by id of each resource and device."""
        resources = {str(entry.id): entry.key for entry in self.lab.resources}
        return resources | {str(entry.id): entry.key for entry in self.lab.devices}

    @cached_property
    def view(self) -> PlannerView:
        devices = [
            AdmittedDevice(
                id=entry.id,
                key=entry.key,
                name=entry.name,
                host_id=entry.host_id,
                spec=catalog()[entry.driver],
                transport="virtual:",
                config=dict(entry.config),
                nodes=dict(entry.nodes),
            )
            for entry in self.lab.devices
        ]
        return PlannerView(
            tree=self.lab.tree,
            graph=self.lab.graph,
            devices=tuple(devices),
            snapshot={resource.id: self._state(resource) for resource in self.lab.resources},
        )

    def _state(self, resource: Any) -> ResourceState:  # noqa: ANN401 - a resource
        capacity_ul = resource.config.get("capacity_ul")
        return ResourceState(
            id=resource.id,
            name=resource.name,
            kind=resource.kind,
            parent_id=resource.parent_id,
            contents=self.lab.contents.get(resource.id, {}),
            capacity_nl=None if capacity_ul is None else round(capacity_ul * 1000),
            dead_volume_nl=round(resource.config.get("dead_volume_ul", 0) * 1000),
            data=resource.data,
        )

    def ask(self, wanted: list[Wanted], *, is_chain: bool = True) -> dict[str, Any] | Refusal:
        """Compile transfers, one after another or side by side."""
        steps = [
            {
                "id": want.step_id,
                "kind": "transfer",
                "params": {
                    "source": self.ids[want.source],
                    "target": self.ids[want.target],
                    "volume": f"{want.amount_nl} nL",
                },
            }
            for want in wanted
        ]
        pairs = list(itertools.pairwise(wanted)) if is_chain else []
        edges = [
            {"id": f"e{place}", "source": one.step_id, "source_port": "done"}
            | {"target": other.step_id, "target_port": "start"}
            for place, (one, other) in enumerate(pairs)
        ]
        document = {"schema": "labweb.workflow/1", "name": "Ask", "steps": steps, "edges": edges}
        return self.compile(document)

    def compile(self, document: dict[str, Any]) -> dict[str, Any] | Refusal:
        """Return the plan as JSON, or why there is none."""
        try:
            plan = compile_workflow(parse_workflow(document), self.view)
        except LabError as error:
            return Refusal(error.findings)
        return dict(json.loads(encode(plan)))


@dataclass(frozen=True)
class Refusal:
    """Why the compiler made no plan."""

    findings: tuple[Finding, ...]

    @property
    def codes(self) -> set[str]:
        return {finding.code for finding in self.findings}
