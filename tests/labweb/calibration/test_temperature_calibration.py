"""A heater is calibrated beside a thermometer: who reads what, and what keeps it from going."""

from __future__ import annotations

from datetime import date, timedelta
from typing import Any
from uuid import uuid4

import pytest

from labweb.approvals.models import ApprovalRequest
from labweb.calibration import selectors as calibration_selectors
from labweb.calibration.models import Calibration
from labweb.calibration.services import calibrations
from labweb.common.clock import now
from labweb.crutd import services as crutd_services
from labweb.domain.calibration.calibration_order import Reference, TemperatureOrder
from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.errors import InfeasibleError, PreconditionError
from labweb.enrollment import services as enrollment_services
from labweb.runs import services
from labweb.runs.models import Job, Run
from tests.builders import HEAT, Bench
from tests.labweb.calibration.test_calibrations import finish
from tests.labweb.web import read, signed_in

SET_POINTS_C = [30.0, 55.0, 80.0]


@pytest.fixture
def wet(bench: Bench) -> Bench:
    """Return the bench with water in its reactor, which stands on heater 1 with pH 1 in it."""
    water = TransferLiquid(
        source_id=bench.node("water").id,
        target_id=bench.node("reactor_1").id,
        amount_nl=20_000_000,
    )
    crutd_services.carry_out(water, lab=bench.lab, actor_id=bench.people["chemist"].pk)
    return bench


def an_order(bench: Bench, **changes: Any) -> TemperatureOrder:  # noqa: ANN401
    reference = Reference(name="pH 1", certificate="K-1", expanded=0.1, due_on=date(2099, 1, 1))
    wanted: dict[str, Any] = {
        "vessel_id": bench.node("reactor_1").id,
        "thermometer_id": bench.device("ph_1").id,
        "reference": reference,
        "set_points_c": list(reversed(SET_POINTS_C)),
        "settle_s": 60.0,
        "stir_speed_rpm": 300.0,
    }
    return TemperatureOrder(**wanted | changes)


def begun(bench: Bench, **changes: Any) -> Calibration:  # noqa: ANN401
    order = an_order(bench, **changes)
    heater = bench.device("heater_1").id
    return calibrations.begin_calibration(heater, order, actor=bench.people["chemist"])


def end(bench: Bench, row: Calibration) -> None:
    """Let a second person release the heating, and every job end well."""
    request = ApprovalRequest.objects.get(run_id=row.run_id)
    services.decide_request(
        request.id, actor=bench.people["approver"], is_approved=True, comment=""
    )
    finish(row)


def compare(row: Calibration) -> None:
    """Let a probe that tells 3 % and 2 K too much have been held beside a true one."""
    true_c = 0.0
    for job in row.run.jobs.order_by("index"):
        if job.action == "hold":
            true_c = (job.args["temperature_c"] - 2.0) / 1.03
        told_c = {"hold": job.args.get("temperature_c"), "measure": true_c}.get(job.action)
        if told_c is not None:
            report = {"evidence": {"temperature_c": round(told_c, 2)}}
            Job.objects.filter(pk=job.pk).update(evidence={"report": report})


def measured(bench: Bench, **changes: Any) -> Calibration:  # noqa: ANN401
    row = begun(bench, **changes)
    end(bench, row)
    compare(row)
    assert calibrations.judge_ended() == 1
    return calibration_selectors.find_calibration(row.id)


def accepted(bench: Bench) -> Calibration:
    row = measured(bench)
    return calibrations.decide_calibration(
        row.id, actor=bench.people["approver"], is_accepted=True, comment="fine"
    )


def test_each_set_point_is_reached_held_and_read_from_the_lowest_up(wet: Bench) -> None:
    jobs = list(begun(wet).run.jobs.order_by("index"))
    acts = [job.action for job in jobs]
    per = ["stir", "heat_to", *(["hold", "measure"] * 3)]
    assert acts == [*per * 3, "stop_heating", "stop_stirring"]
    held = [job.args["temperature_c"] for job in jobs if job.action == "hold"]
    assert held == [c for c in SET_POINTS_C for _ in range(3)]
    assert {job.args["duration_s"] for job in jobs if job.action == "hold"} == {60.0}


def test_slope_and_offset_are_found_accepted_and_sent_from_the_next_plan_on(wet: Bench) -> None:
    row = measured(wet)
    assert (row.state, row.findings) == ("awaiting", [])
    assert row.result is not None
    assert row.result["gain"] == pytest.approx(1 / 1.03, abs=1e-3)
    assert row.points[0]["comparison"]["sent_c"] == 30.0
    calibrations.decide_calibration(
        row.id, actor=wet.people["approver"], is_accepted=True, comment="fine"
    )
    plan = services.preview(wet.lab, wet.version(HEAT).document).plan
    (job,) = [job for job in plan.jobs if job.action == "heat_to"]
    assert job.args["temperature_c"] == pytest.approx(1.03 * 60 + 2, abs=0.05)
    assert job.corrections[0].asked == 60.0


def test_an_expired_one_corrects_nothing_and_one_that_needs_it_is_refused(wet: Bench) -> None:
    row = accepted(wet)
    Calibration.objects.filter(pk=row.pk).update(expires_at=now() - timedelta(seconds=1))
    document = wet.version(HEAT).document
    plan = services.preview(wet.lab, document).plan
    (job,) = [job for job in plan.jobs if job.action == "heat_to"]
    assert job.args["temperature_c"] == 60.0
    needing = {
        **document,
        "steps": [
            {**one, "params": one["params"] | {"accuracy": "0.5 K"}}
            if one["kind"] == "heat_chill"
            else one
            for one in document["steps"]
        ],
    }
    with pytest.raises(InfeasibleError) as caught:
        services.preview(wet.lab, needing)
    assert {one.code for one in caught.value.findings} == {"calibration.expired"}


def test_a_certificate_that_ended_before_the_last_reading_is_a_finding(wet: Bench) -> None:
    today = now().date()
    reference = Reference(name="pH 1", certificate="K-1", expanded=0.1, due_on=today)
    row = begun(wet, reference=reference)
    end(wet, row)
    compare(row)
    Run.objects.filter(pk=row.run_id).update(ended_at=now() + timedelta(days=2))
    calibrations.judge_ended()
    row = calibration_selectors.find_calibration(row.id)
    assert [one["code"] for one in row.findings] == ["calibration.reference_expired"]
    with pytest.raises(PreconditionError):
        calibrations.decide_calibration(
            row.id, actor=wet.people["approver"], is_accepted=True, comment=""
        )


def test_a_reading_that_is_missing_is_named(wet: Bench) -> None:
    row = begun(wet)
    end(wet, row)
    calibrations.judge_ended()
    row = calibration_selectors.find_calibration(row.id)
    assert row.state == "failed"
    assert len(row.findings) == 9
    assert {one["code"] for one in row.findings} == {"calibration.no_reading"}


@pytest.mark.parametrize(
    ("changes", "codes"),
    [
        (
            {"reference": Reference(
                name="pH 1", certificate=" ", expanded=0.1, due_on=date(2020, 1, 1)
            )},
            ["no_reference", "reference_expired"],
        ),
        ({"vessel_id": "flask_1"}, ["not_on_heater", "not_in_vessel"]),
        ({"thermometer_id": "balance_1"}, ["not_a_thermometer"]),
        ({"thermometer_id": "heater_1"}, ["not_a_thermometer"]),
    ],
)  # fmt: skip
def test_what_the_lab_cannot_compare_is_refused_with_every_reason(
    wet: Bench, changes: dict[str, Any], codes: list[str]
) -> None:
    known = {"vessel_id": wet.node, "thermometer_id": wet.device}
    given = {key: known[key](value).id if key in known else value for key, value in changes.items()}
    with pytest.raises(PreconditionError) as caught:
        begun(wet, **given)
    assert [one.code.removeprefix("calibration.") for one in caught.value.findings] == codes
    assert not Calibration.objects.exists()


def test_an_empty_vessel_and_what_does_not_heat_are_refused(bench: Bench) -> None:
    with pytest.raises(PreconditionError) as caught:
        begun(bench)
    assert caught.value.code == "calibration.vessel_empty"
    with pytest.raises(PreconditionError) as caught:
        calibrations.begin_calibration(
            bench.device("balance_1").id, an_order(bench), actor=bench.people["chemist"]
        )
    assert caught.value.code == "calibration.not_a_heater"


def test_a_second_thing_that_heats_the_vessel_is_in_the_way(wet: Bench) -> None:
    heater, bench_1 = wet.device("heater_1"), str(wet.node("bench_1").id)
    enrollment_services.found_device(
        wet.lab,
        uuid4(),
        key="oven",
        name="Oven",
        host_id=heater.host_id,
        driver=heater.driver,
        transport="virtual:oven",
        config=heater.config,
        nodes={"heater": bench_1, "stirrer": bench_1},
        state="enrolled",
    )
    with pytest.raises(PreconditionError) as caught:
        begun(wet)
    assert [one.code for one in caught.value.findings] == ["calibration.not_on_heater"]
    assert "is heated by Oven, too" in caught.value.message


def test_the_page_of_a_heater_offers_it_and_that_of_a_probe_does_not(wet: Bench) -> None:
    client = signed_in(wet.people["chemist"])
    told = read(client, f"/api/v1/devices/{wet.device('heater_1').id}/calibrations")
    assert [one["quantity"] for one in told["quantities"]] == ["temperature"]
    told = read(client, f"/api/v1/devices/{wet.device('ph_1').id}/calibrations")
    assert [one["quantity"] for one in told["quantities"]] == ["ph"]
