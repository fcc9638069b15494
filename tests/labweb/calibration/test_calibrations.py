"""Calibrations: who measures, what is judged, who accepts, and how long it holds."""

from __future__ import annotations

import json
from datetime import date, timedelta
from typing import Any

import pytest

from labweb.calibration import selectors as calibration_selectors
from labweb.calibration.models import Calibration
from labweb.calibration.services import calibrations
from labweb.common.clock import now
from labweb.domain.calibration.calibration_order import Reference, VolumeOrder
from labweb.domain.calibration.gravimetric_volume import Surroundings
from labweb.domain.calibration.water_density import z_factor_ul_mg
from labweb.domain.errors import (
    DefinitionError,
    ForbiddenError,
    InfeasibleError,
    PreconditionError,
    StateError,
)
from labweb.runs import services
from labweb.runs.models import Attempt, Job, Run
from labweb.workflows import services as workflow_services
from tests.builders import (
    MOVE_WATER,
    Bench,
    an_edge,
    dispatched,
    next_job,
)
from tests.labweb.web import call, read, signed_in

GAIN = 0.97


def an_order(bench: Bench, **changes: Any) -> VolumeOrder:  # noqa: ANN401
    reference = Reference(
        name="Balance 1", certificate="D-K-1", expanded=0.4, due_on=date(2099, 1, 1)
    )
    wanted: dict[str, Any] = {
        "source_id": bench.node("water").id,
        "target_id": bench.node("flask_1").id,
        "balance_id": bench.device("balance_1").id,
        "around": Surroundings(water_c=22.0, pressure_kpa=101.3),
        "reference": reference,
    }
    return VolumeOrder(**wanted | changes)


def weigh(row: Calibration, gain: float) -> None:
    """Let the balance have told what a pump of that gain brings."""
    mass_mg = 0.0
    for job in row.run.jobs.order_by("index"):
        if job.action == "dispense":
            mass_mg += job.args["volume_ul"] * gain / z_factor_ul_mg(22.0, 101.3)
        if job.action == "weigh":
            report = {"evidence": {"mass_mg": round(mass_mg, 1)}}
            Job.objects.filter(pk=job.pk).update(evidence={"report": report})


def finish(row: Calibration) -> None:
    """Let every job of its run end well, all at once."""
    for state in ("dispatched", "accepted", "running", "completing", "complete"):
        row.run.jobs.update(state=state, ended_at=now())
    Run.objects.filter(pk=row.run_id).update(state="complete", ended_at=now())


def measured(bench: Bench, gain: float = GAIN) -> Calibration:
    """Calibrate pump 1 up to the moment at which a person has to look."""
    row = calibrations.begin_calibration(
        bench.device("pump_1").id, an_order(bench), actor=bench.people["chemist"]
    )
    finish(row)
    weigh(row, gain)
    assert calibrations.judge_ended() == 1
    return calibration_selectors.find_calibration(row.id)


def accepted(bench: Bench, gain: float = GAIN) -> Calibration:
    row = measured(bench, gain)
    return calibrations.decide_calibration(
        row.id, actor=bench.people["approver"], is_accepted=True, comment="fine"
    )


def standing(bench: Bench) -> tuple[str, tuple[str, ...]]:
    (row,) = calibration_selectors.accepted_of([bench.device("pump_1")])[bench.device("pump_1").id]
    found, reasons = calibration_selectors.standing_of(row, bench.device("pump_1"), at=now())
    return found.value, reasons


def test_a_run_of_weighings_becomes_a_result_that_waits_for_a_person(bench: Bench) -> None:
    row = measured(bench)
    assert (row.state, row.findings, row.number) == ("awaiting", [], 1)
    assert row.result is not None
    assert row.result["gain"] == pytest.approx(GAIN, abs=2e-4)
    assert len(row.points) == 9
    assert row.points is not None
    assert row.points[0]["weighing"]["before_mg"] == 0.0
    assert row.expires_at is None


def test_who_measured_does_not_accept_and_the_next_plan_is_corrected(bench: Bench) -> None:
    row = measured(bench)
    with pytest.raises(ForbiddenError):
        calibrations.decide_calibration(
            row.id, actor=bench.people["chemist"], is_accepted=True, comment=""
        )
    calibrations.decide_calibration(
        row.id, actor=bench.people["approver"], is_accepted=True, comment="fine"
    )
    assert standing(bench) == ("in_force", ())
    plan = services.preview(bench.lab, bench.version(MOVE_WATER).document).plan
    draws = [job for job in plan.jobs if job.action == "aspirate"]
    assert sum(job.corrections[0].asked or 0 for job in draws) == 5000
    assert sum(job.args["volume_ul"] for job in draws) == pytest.approx(5000 / GAIN, rel=2e-4)


def test_a_result_with_findings_is_rejected_and_never_accepted(bench: Bench) -> None:
    row = measured(bench, gain=0.5)
    assert [one["code"] for one in row.findings] == ["calibration.gain"]
    with pytest.raises(PreconditionError) as caught:
        calibrations.decide_calibration(
            row.id, actor=bench.people["approver"], is_accepted=True, comment=""
        )
    assert caught.value.findings[0].code == "calibration.gain"
    calibrations.decide_calibration(
        row.id, actor=bench.people["approver"], is_accepted=False, comment="wrong syringe"
    )
    with pytest.raises(StateError):
        calibrations.decide_calibration(
            row.id, actor=bench.people["admin"], is_accepted=True, comment=""
        )


def test_a_newer_one_supersedes_and_a_withdrawn_one_brings_none_back(bench: Bench) -> None:
    first, second = accepted(bench), accepted(bench, 0.98)
    assert (first.number, second.number) == (1, 2)
    (row,) = calibration_selectors.accepted_of([bench.device("pump_1")])[first.device_id]
    assert row.id == second.id
    with pytest.raises(DefinitionError):
        calibrations.withdraw_calibration(second.id, actor=bench.people["approver"], reason=" ")
    calibrations.withdraw_calibration(second.id, actor=bench.people["approver"], reason="leaks")
    assert standing(bench) == ("withdrawn", ("it was withdrawn",))
    assert calibration_selectors.find_calibration(first.id).result == first.result


def test_it_ends_at_its_due_date_and_with_any_change_of_the_device(bench: Bench) -> None:
    row = accepted(bench)
    assert row.measured_at is not None
    assert row.expires_at == row.measured_at + timedelta(days=365)
    device = bench.device("pump_1")
    device.config = {**device.config, "syringe_ul": 2500}
    device.save(update_fields=["config"])
    assert standing(bench) == ("changed", ("its settings were changed",))
    Calibration.objects.filter(pk=row.pk).update(expires_at=now() - timedelta(days=1))
    assert standing(bench)[0] == "changed"
    assert len(standing(bench)[1]) == 2


def test_a_device_that_was_changed_since_it_was_measured_is_not_accepted(bench: Bench) -> None:
    row = measured(bench)
    device = bench.device("pump_1")
    device.transport = "virtual:another"
    device.save(update_fields=["transport"])
    with pytest.raises(PreconditionError) as caught:
        calibrations.decide_calibration(
            row.id, actor=bench.people["approver"], is_accepted=True, comment=""
        )
    assert caught.value.code == "calibration.changed"


def test_a_run_that_ends_early_gives_no_result(bench: Bench) -> None:
    row = calibrations.begin_calibration(
        bench.device("pump_1").id, an_order(bench), actor=bench.people["chemist"]
    )
    services.abort_run(row.run_id, actor=bench.people["chemist"], reason="no water")
    calibrations.judge_ended()
    row = calibration_selectors.find_calibration(row.id)
    assert (row.state, row.findings[0]["code"]) == ("failed", "calibration.incomplete")


def test_a_reading_that_is_missing_is_named(bench: Bench) -> None:
    row = calibrations.begin_calibration(
        bench.device("pump_1").id, an_order(bench), actor=bench.people["chemist"]
    )
    finish(row)
    calibrations.judge_ended()
    row = calibration_selectors.find_calibration(row.id)
    assert row.state == "failed"
    assert {one["code"] for one in row.findings} == {"calibration.no_reading"}


def test_everything_that_speaks_against_an_order_is_told_at_once(bench: Bench) -> None:
    bad = an_order(
        bench,
        target_id=bench.node("flask_2").id,
        repeats=1,
        tolerance=0.0,
        valid_days=0,
        around=Surroundings(water_c=60.0, pressure_kpa=1013.0),
        reference=Reference(name="", certificate="", expanded=0.0, due_on=date(2020, 1, 1)),
    )
    with pytest.raises(PreconditionError) as caught:
        calibrations.begin_calibration(
            bench.device("pump_1").id, bad, actor=bench.people["chemist"]
        )
    assert [one.code.removeprefix("calibration.") for one in caught.value.findings] == [
        "not_water", "not_air", "no_reference", "no_reference", "reference_expired",
        "too_few_points", "tolerance", "validity", "not_on_balance",
    ]  # fmt: skip
    assert not Calibration.objects.exists()


def test_what_is_no_pump_and_no_balance_is_refused(bench: Bench) -> None:
    order = an_order(bench, balance_id=bench.device("heater_1").id)
    with pytest.raises(PreconditionError) as caught:
        calibrations.begin_calibration(
            bench.device("heater_1").id, order, actor=bench.people["chemist"]
        )
    codes = {one.code for one in caught.value.findings}
    assert codes == {"calibration.not_a_pump", "calibration.no_balance"}


def test_two_at_once_of_one_device_are_refused(bench: Bench) -> None:
    pump, chemist = bench.device("pump_1").id, bench.people["chemist"]
    calibrations.begin_calibration(pump, an_order(bench), actor=chemist)
    with pytest.raises(StateError) as caught:
        calibrations.begin_calibration(pump, an_order(bench), actor=chemist)
    assert caught.value.code == "calibration.under_way"


def test_an_observer_calibrates_nothing(bench: Bench) -> None:
    with pytest.raises(ForbiddenError):
        calibrations.begin_calibration(
            bench.device("pump_1").id, an_order(bench), actor=bench.people["observer"]
        )


def test_a_step_that_needs_more_than_is_known_is_refused(bench: Bench) -> None:
    accepted(bench)
    document = json.loads(json.dumps(bench.version(MOVE_WATER).document))
    document["steps"][0]["params"]["accuracy"] = "0.0001 %"
    with pytest.raises(InfeasibleError) as caught:
        services.preview(bench.lab, document)
    codes = {one.code for one in caught.value.findings}
    assert codes == {"calibration.too_uncertain", "calibration.missing"}


def test_the_page_tells_what_can_be_calibrated_and_what_was(bench: Bench) -> None:
    row = accepted(bench)
    client = signed_in(bench.people["approver"])
    told = read(client, f"/api/v1/devices/{bench.device('pump_1').id}/calibrations")
    (volume,) = told["quantities"]
    assert volume["stated"] == {"ratio": 0.01, "absolute": None}
    assert volume["newest"] == str(row.id)
    assert volume["history"][0]["standing"] == "in_force"
    assert volume["history"][0]["can"]["withdraw"] is True
    told = read(client, f"/api/v1/devices/{bench.device('balance_1').id}/calibrations")
    assert told == {"quantities": [], "next": None}
    answer = call(client, "GET", f"/api/v1/calibrations/{bench.lab.id}")
    assert answer.status_code == 404


def to_corrected(bench: Bench, accuracy: str = "") -> Run:
    """Work a run of pump 1 off up to its first corrected job, which is queued."""
    document = json.loads(json.dumps(bench.version(MOVE_WATER).document))
    if accuracy:
        document["steps"][0]["params"]["accuracy"] = accuracy
    chemist = bench.people["chemist"]
    workflow = workflow_services.create_workflow(
        bench.lab, name="Measured", document=document, actor=chemist
    )
    version = workflow_services.save_version(workflow.id, note="", actor=chemist)
    run, edge = services.start_run(version, actor=chemist), an_edge(bench)
    while not next_job(run).corrections:
        edge.complete(dispatched(run))
    return run


@pytest.mark.parametrize("change", ["withdrawn", "settings"])
def test_a_number_that_is_wrong_by_now_is_not_sent(bench: Bench, change: str) -> None:
    row = accepted(bench)
    run = to_corrected(bench)
    if change == "withdrawn":
        calibrations.withdraw_calibration(row.id, actor=bench.people["approver"], reason="leaks")
    else:
        device = bench.device("pump_1")
        device.admitted_at = now()
        device.save(update_fields=["admitted_at"])
    attempts = Attempt.objects.count()
    assert services.dispatch_ready() == 0
    job = next_job(run)
    code = "calibration.withdrawn" if change == "withdrawn" else "calibration.changed"
    assert (job.state, job.code) == ("held", code)
    assert "calibration 1 of volume of " in job.message
    assert Attempt.objects.count() == attempts


@pytest.mark.parametrize(("accuracy", "needs"), [("", None), ("2 %", 0.02)])
def test_a_number_does_not_go_past_the_due_date_of_its_calibration(
    bench: Bench, accuracy: str, needs: float | None
) -> None:
    row = accepted(bench)
    run = to_corrected(bench, accuracy=accuracy)
    assert next_job(run).corrections[0]["needs"] == needs
    Calibration.objects.filter(pk=row.pk).update(expires_at=now() - timedelta(seconds=1))
    services.dispatch_ready()
    assert (next_job(run).state, next_job(run).code) == ("held", "calibration.expired")


def test_a_step_that_asks_nothing_keeps_its_numbers_when_a_newer_one_is_accepted(
    bench: Bench,
) -> None:
    accepted(bench)
    run = to_corrected(bench)
    accepted(bench, 0.98)
    services.dispatch_ready()
    assert next_job(run).state == "dispatched"
