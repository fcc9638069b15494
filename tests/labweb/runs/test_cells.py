"""A potentiostat measures what its electrodes are connected to, and its files say so."""

from __future__ import annotations

from typing import Any

import pytest

from labweb.common.clock import new_id
from labweb.crutd import services as crutd_services
from labweb.domain.crutd.operations import Create, Read, Update, from_json
from labweb.domain.errors import LabError
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.runs.host_journal.action_states import ActionReport
from labweb.enrollment import services as enrollment_services
from labweb.resources.models import Connection
from labweb.runs import services
from labweb.runs.models import Job
from labweb.telemetry import services as telemetry_services
from labweb.telemetry.models import File, Incoming
from labweb.workflows import services as workflow_services
from tests.builders import Bench, catalog
from tests.labweb.runs.hosts import Host
from tests.labweb.runs.test_action_files import TABLE, brought, lab, named
from tests.labweb.web import read, signed_in

__all__ = ["lab"]

POTENTIOSTAT = "drivers.characterization.palmsens_emstat_pico:PalmsensEmstatPico"
CYCLER = "drivers.characterization.neware_bts:NewareBts"
HOLD = {"potential_v": 0.5, "duration_s": 1.0, "interval_s": 0.1}
OPEN = {"duration_s": 1.0, "interval_s": 0.1}


def set_up(lab: Bench, role: str, driver: str, *wired: str) -> None:
    """Put an instrument on the bench, and its electrodes into vessels."""
    device = Create(
        resource_id=new_id(), parent_id=lab.node("bench_1").id, key=role, name="EC", kind=role
    )
    crutd_services.carry_out(device, lab=lab.lab, actor_id=lab.people["admin"].pk)
    for key in wired:
        Connection.objects.create(
            lab=lab.lab, key=f"wire_{key}", source=lab.node(role), target=lab.node(key),
            source_port="cell", medium=Medium.ELECTRICAL,
        )  # fmt: skip
    enrollment_services.found_device(
        lab.lab,
        new_id(),
        key=role,
        name="EC",
        host_id=lab.host.id,
        driver=enrollment_services.keep_driver(catalog()[driver]),
        transport="tcp://127.0.0.1:9",
        config={},
        nodes={role: str(lab.node(role).id)},
        state="enrolled",
    )


def measured(lab: Bench, role: str, action: str, args: dict[str, Any], sample: str = "") -> Job:
    """Start a workflow of one measurement; its host tells that it has a file of it."""
    params: dict[str, Any] = {"device": str(lab.node(role).id), "action": action, "args": args}
    if sample:
        params["sample"] = str(lab.node(sample).id)
    step = {"id": "m", "kind": "device_action", "params": params, "position": {"x": 0, "y": 0}}
    document = {"schema": "labweb.workflow/1", "name": "EC", "steps": [step], "edges": []}
    chemist = lab.people["chemist"]
    workflow = workflow_services.create_workflow(
        lab.lab, name="EC", document=document, actor=chemist
    )
    version = workflow_services.save_version(workflow.id, note="", actor=chemist)
    run = services.start_run(version, actor=chemist)
    host = Host(lab)
    assert services.dispatch_ready() == 1
    host.take()
    assert host.step(report=ActionReport(ok=True, files=(named(TABLE),)))
    host.tell()
    return Job.objects.get(run=run)


def refusals(lab: Bench, *asked: Any) -> list[tuple[str, str]]:  # noqa: ANN401
    with pytest.raises(LabError) as refusal:
        measured(lab, *asked)
    return [(one.code, one.message) for one in refusal.value.findings]


def test_what_a_hold_of_the_potential_measured_leads_to_what_stood_in_the_cell(lab: Bench) -> None:
    set_up(lab, "potentiostat", POTENTIOSTAT, "flask_2")
    job = measured(lab, "potentiostat", "hold_potential", HOLD)
    flask = lab.node("flask_2")
    operation = from_json(job.operation)
    assert isinstance(operation, Update)
    assert operation.sample_id == flask.id
    brought(lab, job.attempts.get(), TABLE)
    telemetry_services.read_incoming(Incoming.objects.get().pk)
    file = File.objects.get(made_from=None)
    assert file.resource_id == flask.id
    client = signed_in(lab.people["chemist"])
    told = read(client, f"/api/v1/files/{file.pk}/provenance")
    assert flask.name in str(told)


def test_the_cell_is_locked_while_it_is_measured(lab: Bench) -> None:
    set_up(lab, "potentiostat", POTENTIOSTAT, "flask_2")
    job = measured(lab, "potentiostat", "measure_open_circuit", OPEN)
    assert isinstance(from_json(job.operation), Read)
    assert str(lab.node("flask_2").id) in str(job.run.plan)


def test_of_two_cells_one_has_to_be_named(lab: Bench) -> None:
    set_up(lab, "potentiostat", POTENTIOSTAT, "flask_2", "flask_1")
    ((code, message),) = refusals(lab, "potentiostat", "hold_potential", HOLD)
    assert code == "plan.no_sample"
    assert lab.node("flask_1").name in message
    assert lab.node("flask_2").name in message
    job = measured(lab, "potentiostat", "hold_potential", HOLD, "flask_1")
    assert Incoming.objects.get().resource_id == lab.node("flask_1").id
    assert job.state == "complete"


def test_a_vessel_without_the_electrodes_is_refused(lab: Bench) -> None:
    set_up(lab, "potentiostat", POTENTIOSTAT, "flask_2")
    ((code, message),) = refusals(lab, "potentiostat", "hold_potential", HOLD, "flask_1")
    assert code == "plan.sample_elsewhere"
    assert "its electrodes are not connected to it" in message


def test_without_a_connection_nothing_is_linked(lab: Bench) -> None:
    set_up(lab, "potentiostat", POTENTIOSTAT)
    measured(lab, "potentiostat", "hold_potential", HOLD)
    assert Incoming.objects.get().resource_id is None


def test_the_end_of_a_measurement_measures_nothing(lab: Bench) -> None:
    set_up(lab, "potentiostat", POTENTIOSTAT, "flask_2")
    ((code, message),) = refusals(lab, "potentiostat", "stop_measuring", {}, "flask_2")
    assert (code, message) == ("plan.no_sample", "stop_measuring of EC measures no sample")
    measured(lab, "potentiostat", "stop_measuring", {})
    assert Incoming.objects.get().resource_id is None


def test_what_a_battery_tester_measures_is_of_the_cell_in_its_holder(lab: Bench) -> None:
    """battery tester ── electrical ── slot, in which the cell stands"""
    holder = Create(
        resource_id=new_id(), parent_id=lab.node("bench_1").id, key="holder", name="Holder",
        kind="slot",
    )  # fmt: skip
    crutd_services.carry_out(holder, lab=lab.lab, actor_id=lab.people["admin"].pk)
    cell = lab.unplug("flask_2")
    cell.parent = lab.node("holder")
    cell.save()
    set_up(lab, "battery_tester", CYCLER, "holder")
    measured(lab, "battery_tester", "await_end", {"duration_s": 5.0})
    assert Incoming.objects.get().resource_id == cell.id
