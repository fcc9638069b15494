"""An analyser draws from its sample: what is gone leaves the record, and files are the sample's."""

from __future__ import annotations

from typing import Any

import pytest

from labweb.common.clock import new_id
from labweb.crutd import selectors as crutd_selectors
from labweb.crutd import services as crutd_services
from labweb.domain.crutd.operations import Create
from labweb.domain.errors import Effect, LabError
from labweb.domain.runs.host_journal.action_states import ActionReport
from labweb.enrollment import services as enrollment_services
from labweb.runs import services
from labweb.runs.models import Job
from labweb.telemetry.models import Incoming
from labweb.workflows import services as workflow_services
from tests.builders import Bench, catalog
from tests.labweb.runs.hosts import Host
from tests.labweb.runs.test_action_files import TABLE, named

DRIVER = "drivers.characterization.lab_hplc:LabHplc"
ARGS = {"vial": "1", "method": "standard", "injection_ul": 5.0, "sample": "a1"}


@pytest.fixture
def lab(bench: Bench) -> Bench:
    """Set the bottle of acid into an HPLC."""
    sampler = Create(
        resource_id=new_id(), parent_id=bench.node("bench_1").id, key="hplc", name="HPLC",
        kind="workstation",
    )  # fmt: skip
    crutd_services.carry_out(sampler, lab=bench.lab, actor_id=bench.people["admin"].pk)
    bench.unplug("acid")
    bottle = bench.node("acid")
    bottle.parent = bench.node("hplc")
    bottle.save()
    enrollment_services.found_device(
        bench.lab,
        new_id(),
        key="hplc",
        name="HPLC",
        host_id=bench.host.id,
        driver=enrollment_services.keep_driver(catalog()[DRIVER]),
        transport="http://127.0.0.1:9",
        config={},
        nodes={"analyser": str(bench.node("hplc").id)},
        state="enrolled",
    )
    return bench


def held_nl(lab: Bench) -> int:
    bottle = lab.node("acid").id
    return sum(crutd_selectors.contents([bottle]).get(bottle, {}).values())


def injected(lab: Bench, report: ActionReport, **changes: Any) -> Job:  # noqa: ANN401
    """Start a workflow of one injection, and have the host report so."""
    params = {
        "device": str(lab.node("hplc").id),
        "action": "measure",
        "args": ARGS,
        "sample": str(lab.node("acid").id),
        **changes,
    }
    params = {name: value for name, value in params.items() if value is not None}
    step = {"id": "i", "kind": "device_action", "params": params, "position": {"x": 0, "y": 0}}
    document = {"schema": "labweb.workflow/1", "name": "HPLC", "steps": [step], "edges": []}
    chemist = lab.people["chemist"]
    workflow = workflow_services.create_workflow(
        lab.lab, name="HPLC", document=document, actor=chemist
    )
    version = workflow_services.save_version(workflow.id, note="", actor=chemist)
    run = services.start_run(version, actor=chemist)
    host = Host(lab)
    assert services.dispatch_ready() == 1
    host.take()
    assert host.step(report=report)
    host.tell()
    return Job.objects.get(run=run)


def a_failure(effect: Effect, moved_nl: int | None) -> ActionReport:
    return ActionReport(
        ok=False, effect=effect, moved_nl=moved_nl, code="device.failed", message="m"
    )


def test_what_was_drawn_is_gone_and_the_file_is_the_samples(lab: Bench) -> None:
    before = held_nl(lab)
    assert before > 5000
    job = injected(lab, ActionReport(ok=True, moved_nl=5000, files=(named(TABLE),)))
    assert (job.state, before - held_nl(lab)) == ("complete", 5000)
    assert Incoming.objects.get().resource_id == lab.node("acid").id


@pytest.mark.parametrize(
    ("effect", "moved_nl", "state", "gone_nl"),
    [
        (Effect.NONE, None, "aborted", 0),
        (Effect.PARTIAL, 5000, "aborted", 5000),
        (Effect.UNKNOWN, None, "in_doubt", 0),
    ],
)
def test_a_run_that_ended_early_leaves_what_its_device_tells(
    lab: Bench, effect: Effect, moved_nl: int | None, state: str, gone_nl: int
) -> None:
    before = held_nl(lab)
    job = injected(lab, a_failure(effect, moved_nl))
    assert (job.state, before - held_nl(lab)) == (state, gone_nl)
    is_closed = lab.node("acid").quarantined_by is not None
    assert is_closed is (state == "in_doubt")


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"sample": None}, "plan.no_sample"),
        ({"args": {**ARGS, "injection_ul": 1.00001}}, "plan.off_grid"),
    ],
)
def test_an_injection_that_cannot_be_recorded_is_refused(
    lab: Bench, changes: dict[str, Any], code: str
) -> None:
    with pytest.raises(LabError) as refusal:
        injected(lab, ActionReport(ok=True), **changes)
    assert [one.code for one in refusal.value.findings] == [code]


def test_a_sample_that_stands_elsewhere_is_refused(lab: Bench) -> None:
    other = {"sample": str(lab.node("flask_2").id)}
    with pytest.raises(LabError) as refusal:
        injected(lab, ActionReport(ok=True), **other)
    assert [one.code for one in refusal.value.findings] == ["plan.sample_elsewhere"]
