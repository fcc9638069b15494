"""A plan carried out action by action, by the real drivers on the simulated instruments.

No server and no edge host: what is tried is the plan, the drivers, the bytes and the matter.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from uuid import UUID

from drivers.base import Driver
from drivers.transports.urls import make_transport
from labweb.domain.crutd.ledger import Account
from labweb.domain.crutd.mass_balance import MassMove
from labweb.domain.crutd.operations import React, TransferLiquid
from labweb.domain.crutd.settlement import Outcome, OutcomeKind, confirmed_nl, settle
from labweb.domain.crutd.snapshot import ResourceState
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.graph.lab_file.simulated_bench import bench_for, endpoints_needed
from labweb.domain.resources.contents_by_lot import LotId, add, remove
from labweb.domain.workflows.compile_workflow import PlannerView
from labweb.domain.workflows.plan import Plan, PlannedJob
from tests.fixtures.running import Process

WAITS_S = {"settle_s": 5.0, "poll_s": 10.0, "lift_s": 20.0}
"""What drivers wait between two looks, in the bench's own time."""


class BenchRun:
    """The lab's record, its drivers and its bench."""

    def __init__(
        self, lab: LabFile, view: PlannerView, bench: Process, drivers: Mapping[UUID, Any]
    ) -> None:
        self.lab, self.bench, self.drivers = lab, bench, drivers
        self.states: dict[UUID, ResourceState] = dict(view.snapshot)
        self.moves: list[MassMove] = []
        self.reactions: list[React] = []
        self.ids = {resource.key: resource.id for resource in lab.resources}

    def carry_out(self, plan: Plan) -> None:
        """Do every job in the order of the plan, and settle each by the rules of the record."""
        for job in plan.jobs:
            driver = self.drivers[job.device_id]
            try:
                report = getattr(driver, job.action)(**job.args)
            except Exception as error:
                raise AssertionError(f"{job.index} {job.sentence}: {error}") from error
            self._settle(job, report.moved_ul, report.resolution_ul)

    def _settle(self, job: PlannedJob, moved_ul: float | None, resolution_ul: float | None) -> None:
        operation, moved_nl = job.operation, None
        if isinstance(operation, TransferLiquid) and moved_ul is not None:
            finest = round((resolution_ul or 0.0) * 1000)
            moved_nl = confirmed_nl(operation.amount_nl, round(moved_ul * 1000), finest)
        outcome = Outcome(kind=OutcomeKind.DONE, moved_nl=moved_nl)
        for posting in settle(operation, self.states, outcome).postings:
            for account, move in ((posting.debit, remove), (posting.credit, add)):
                if account not in Account.__members__:
                    state = self.states[UUID(account)]
                    held = move(state.contents, {posting.lot: posting.amount_nl})
                    self.states[state.id] = replace(state, contents=held)
            self.moves.append(
                MassMove(posting.lot, posting.debit, posting.credit, posting.amount_nl)
            )
        if isinstance(operation, React):
            self.reactions.append(operation)

    def recorded_ul(self, key: str) -> dict[LotId, float]:
        """Return what the record says that a vessel holds."""
        held = self.states[self.ids[key]].contents
        return {lot: amount / 1000 for lot, amount in held.items()}

    def really_ul(self, key: str) -> dict[str, float]:
        """Return what a vessel really holds."""
        told = self.bench.get("/world")["vessels"][key]["contents"]
        return {name: amount / 1000 for name, amount in told.items()}


@contextmanager
def bench_run(lab: LabFile, view: PlannerView, folder: Path, *, speed: int) -> Iterator[BenchRun]:
    """Start the bench of a lab file and its drivers, each with its plunger or valve as it is."""
    ends = {
        line: f"pty:{folder / f'line{number}'}"
        for number, (line, carrier) in enumerate(endpoints_needed(lab))
        if carrier == "pty"
    }
    document = bench_for(lab, ends)
    document["chemistry"] = json.loads(
        (Path(__file__).parents[2] / "fixtures/labs/organic_synthesis/chemistry.json").read_text()
    )
    (folder / "bench.json").write_text(json.dumps(document))
    bench = Process(folder)
    bench.start("--speed", str(speed))
    drivers: dict[UUID, Driver[Any, Any]] = {}
    try:
        for entry in lab.devices:
            module, _, name = entry.driver.partition(":")
            url = "virtual:timer"
            if entry.line in ends:
                path = ends[entry.line].removeprefix("pty:")
                url = f"serial://{path}?baud=9600&format=8N1"
            driver_type = getattr(importlib.import_module(module), name)
            known = driver_type.config_type.__struct_fields__
            waits = {field: wait_s for field, wait_s in WAITS_S.items() if field in known}
            driver = driver_type(make_transport(url), {**waits, **entry.config})
            driver.pace = speed
            driver.connect()
            drivers[entry.id] = driver
        yield BenchRun(lab, view, bench, drivers)
    finally:
        for driver in drivers.values():
            driver.close()
        bench.stop()
