"""What a calibration does to a plan: corrected numbers, and devices that are refused."""

from __future__ import annotations

from typing import Any
from uuid import UUID

import msgspec
import pytest

from labweb.domain.approvals.approval_policy import TemperatureAtLeast, asks
from labweb.domain.calibration.correction import (
    AcceptedCalibration,
    CalibrationQuantity,
    CalibrationStanding,
    CorrectionLevel,
)
from labweb.domain.enrollment.driver_spec import AccuracySpec
from tests.domain.workflows.asking import findings_of, moved_nl, plan_of, the_job
from tests.domain.workflows.bench import Bench, a_bench, flow, step, transfer

GAIN = 0.97


def calibration(gain: float = GAIN, **changes: Any) -> AcceptedCalibration:  # noqa: ANN401
    """Return a calibration of a 5 mL pump at 10, 50 and 100 %, to 0.4 %."""
    levels = tuple(
        CorrectionLevel(value=gain * device, expanded=0.004 * gain * device)
        for device in (500.0, 2500.0, 5000.0)
    )
    made = AcceptedCalibration(
        id=UUID(int=7), quantity=CalibrationQuantity.VOLUME, number=2, gain=gain, levels=levels
    )
    return msgspec.structs.replace(made, **changes)


def with_calibration(*made: AcceptedCalibration, unit: str = "volume_ul") -> Bench:
    """Return the usual bench whose devices' numbers of one name can be calibrated."""
    bench = a_bench(syringe_ul=5000.0)
    quantity = "volume" if unit == "volume_ul" else "temperature"
    for place, device in enumerate(bench.devices):
        marked = AccuracySpec(ratio=0.01)
        actions = tuple(
            msgspec.structs.replace(
                action,
                parameters=tuple(
                    msgspec.structs.replace(one, accuracy=marked, quantity=quantity)
                    if one.name == unit
                    else one
                    for one in action.parameters
                ),
            )
            for action in device.spec.actions
        )
        statuses = tuple(
            msgspec.structs.replace(
                one,
                value=msgspec.structs.replace(one.value, accuracy=marked, quantity=quantity),
            )
            if one.name == unit
            else one
            for one in device.spec.statuses
        )
        spec = msgspec.structs.replace(device.spec, actions=actions, statuses=statuses)
        bench.devices[place] = msgspec.structs.replace(device, spec=spec, calibrations=made)
    return bench


def moving(volume: str, **params: Any) -> dict[str, Any]:  # noqa: ANN401
    document = flow(transfer("t", "water", "reactor", volume))
    document["steps"][0]["params"] |= params
    return document


def test_a_stroke_is_sent_corrected_and_both_numbers_are_kept() -> None:
    plan = plan_of(with_calibration(calibration()), moving("2 mL"))
    draw = the_job(plan, "aspirate")
    assert draw.args["volume_ul"] == pytest.approx(2000 / GAIN)
    (kept,) = draw.corrections
    assert (kept.argument, kept.asked, kept.sent) == ("volume_ul", 2000.0, draw.args["volume_ul"])
    assert (kept.number, kept.calibration_id) == (2, UUID(int=7))
    assert moved_nl(plan, "water", "pump_1") == 2_000_000


def test_the_plunger_is_watched_on_its_own_scale() -> None:
    draw = the_job(plan_of(with_calibration(calibration()), moving("2 mL")), "aspirate")
    (after,) = [one for one in draw.post if one.status == "volume_ul"]
    assert after.low == after.high == draw.args["volume_ul"]


def test_a_full_stroke_ends_where_the_calibration_ends() -> None:
    plan = plan_of(with_calibration(calibration()), moving("5 mL"))
    strokes = [job.args["volume_ul"] for job in plan.jobs if job.action == "aspirate"]
    assert len(strokes) == 2
    assert max(strokes) <= 5000
    assert moved_nl(plan, "water", "pump_1") == 5_000_000


def test_a_pump_that_moves_too_much_never_fills_its_syringe_beyond_the_record() -> None:
    plan = plan_of(with_calibration(calibration(1.03)), moving("5 mL"))
    (stroke,) = [job.args["volume_ul"] for job in plan.jobs if job.action == "aspirate"]
    assert stroke == pytest.approx(5000 / 1.03)


def test_without_a_calibration_nothing_changes() -> None:
    assert plan_of(with_calibration(), moving("2 mL")) == plan_of(
        a_bench(syringe_ul=5000.0), moving("2 mL")
    )


def test_one_that_does_not_hold_corrects_nothing() -> None:
    gone = calibration(standing=CalibrationStanding.EXPIRED, reasons=("it was due on 2026-01-01",))
    draw = the_job(plan_of(with_calibration(gone), moving("2 mL")), "aspirate")
    assert draw.args["volume_ul"] == 2000.0
    assert draw.corrections == ()


def test_a_step_that_needs_one_percent_is_refused_on_a_pump_without_calibration() -> None:
    (found,) = findings_of(with_calibration(), moving("2 mL", accuracy="1 %"))
    assert found.code == "calibration.missing"
    assert found.message == (
        "Pump 1 has no calibration of volume, and the step needs 1 % (its maker states 1 %, which "
        "nobody has measured): calibrate it on its page"
    )


@pytest.mark.parametrize(
    ("changes", "volume", "wanted", "code"),
    [
        ({}, "2 mL", "0.3 %", "calibration.too_uncertain"),
        ({}, "0.2 mL", "1 %", "calibration.out_of_range"),
        ({"standing": CalibrationStanding.EXPIRED, "reasons": ("due",)}, "2 mL", "1 %",
         "calibration.expired"),
        ({"standing": CalibrationStanding.CHANGED, "reasons": ("new",)}, "2 mL", "1 %",
         "calibration.changed"),
        ({"standing": CalibrationStanding.WITHDRAWN, "reasons": ("x",)}, "2 mL", "1 %",
         "calibration.withdrawn"),
    ],
)  # fmt: skip
def test_a_pump_that_is_not_known_to_be_good_enough_is_refused(
    changes: dict[str, Any], volume: str, wanted: str, code: str
) -> None:
    bench = with_calibration(calibration(**changes))
    assert [one.code for one in findings_of(bench, moving(volume, accuracy=wanted))] == [code]


def test_a_calibrated_pump_does_what_a_step_needs() -> None:
    plan = plan_of(with_calibration(calibration()), moving("2 mL", accuracy="0.5 %"))
    assert plan.steps[0].sentence == "Transfer 2 mL from Water to Reactor to within 0.5 %"


def test_a_corrected_number_beyond_what_the_device_takes_is_refused() -> None:
    heat = calibration(
        gain=0.4, quantity=CalibrationQuantity.TEMPERATURE,
        levels=(
            CorrectionLevel(value=0.0, expanded=0.2),
            CorrectionLevel(value=300.0, expanded=0.2),
        ),
    )  # fmt: skip
    bench = with_calibration(heat, unit="temperature_c")
    document = flow(step("h", "heat_chill", vessel="@reactor", temperature="140 °C"))
    assert "driver.argument_range" in {one.code for one in findings_of(bench, document)}


def test_a_policy_looks_at_the_temperature_that_was_asked_for() -> None:
    heat = calibration(
        gain=1.1, quantity=CalibrationQuantity.TEMPERATURE,
        levels=(
            CorrectionLevel(value=0.0, expanded=0.2),
            CorrectionLevel(value=300.0, expanded=0.2),
        ),
    )  # fmt: skip
    bench = with_calibration(heat, unit="temperature_c")
    document = flow(step("h", "heat_chill", vessel="@reactor", temperature="60 °C"))
    plan = plan_of(bench, document)
    assert plan.jobs[0].args["temperature_c"] < 60
    assert asks(TemperatureAtLeast(temperature_c=60.0), plan)


def a_warm_probe(**changes: Any) -> Bench:  # noqa: ANN401
    """Return the usual bench with a heater that is calibrated from 30 to 80 °C, to 0.3 K."""
    levels = tuple(CorrectionLevel(value=c, expanded=0.3) for c in (30.0, 55.0, 80.0))
    heat = calibration(
        gain=1 / 1.03,
        offset=-2.0 / 1.03,
        quantity=CalibrationQuantity.TEMPERATURE,
        levels=levels,
        **changes,
    )
    return with_calibration(heat, unit="temperature_c")


def heating(temperature: str, **params: Any) -> dict[str, Any]:  # noqa: ANN401
    return flow(step("h", "heat_chill", vessel="@reactor", temperature=temperature, **params))


def test_a_set_point_is_sent_corrected_and_watched_on_the_probes_own_scale() -> None:
    plan = plan_of(a_warm_probe(), heating("60 °C", hold_for="10 min"))
    for action in ("heat_to", "hold"):
        job = the_job(plan, action)
        assert job.args["temperature_c"] == pytest.approx(1.03 * 60 + 2)
        (kept,) = job.corrections
        assert (kept.argument, kept.asked, kept.sent) == (
            "temperature_c", 60.0, job.args["temperature_c"],
        )  # fmt: skip
        (after,) = [one for one in job.post if one.status == "temperature_c"]
        assert after.low == after.high == job.args["temperature_c"]
    assert plan.steps[0].sentence == "Bring Reactor to 60 °C, hold for 10 min"


@pytest.mark.parametrize("temperature", ["22 °C", "81 °C", "120 °C"])
def test_a_temperature_beyond_what_was_compared_is_refused(temperature: str) -> None:
    (found,) = findings_of(a_warm_probe(), heating(temperature, hold_for="10 min"))
    assert found.code == "calibration.out_of_range"
    assert "was calibrated from 30 to 80 °C" in found.message


def test_without_a_calibration_in_force_a_set_point_is_sent_as_asked() -> None:
    gone = a_warm_probe(standing=CalibrationStanding.EXPIRED, reasons=("it was due on 2026-01-01",))
    job = the_job(plan_of(gone, heating("120 °C")), "heat_to")
    assert (job.args["temperature_c"], job.corrections) == (120.0, ())


@pytest.mark.parametrize(
    ("changes", "wanted", "code"),
    [
        ({}, "0.2 K", "calibration.too_uncertain"),
        (
            {"standing": CalibrationStanding.EXPIRED, "reasons": ("due",)},
            "0.5 K",
            "calibration.expired",
        ),
        (
            {"standing": CalibrationStanding.WITHDRAWN, "reasons": ("x",)},
            "0.5 K",
            "calibration.withdrawn",
        ),
    ],
)
def test_a_heater_that_is_not_known_to_be_good_enough_is_refused(
    changes: dict[str, Any], wanted: str, code: str
) -> None:
    found = findings_of(a_warm_probe(**changes), heating("60 °C", accuracy=wanted))
    assert [one.code for one in found] == [code]


def test_a_step_that_needs_half_a_kelvin_is_reached_to_within_half_a_kelvin() -> None:
    plan = plan_of(a_warm_probe(), heating("60 °C", accuracy="0.5 K", hold_for="1 min"))
    for action in ("heat_to", "hold"):
        job = the_job(plan, action)
        assert job.args["tolerance_c"] == 0.5
        assert job.corrections[0].needs == 0.5
    assert plan.steps[0].sentence == "Bring Reactor to 60 °C to within 0.5 K, hold for 1 min"
