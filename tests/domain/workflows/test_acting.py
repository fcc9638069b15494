from __future__ import annotations

from typing import Any

import pytest

from labweb.domain.crutd.operations import Read, Update
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.enrollment.driver_spec import DriverSpec, ParameterSpec, StatusSpec
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.workflows.passes.role_requirements import (
    READ_AFTER,
    READ_BEFORE,
    post_conditions,
)
from tests.domain.workflows.asking import (
    actions,
    codes_of,
    findings_of,
    plan_of,
    the_job,
)
from tests.domain.workflows.bench import (
    BALANCE,
    HEATER,
    Bench,
    a_bench,
    chain,
    device_id_of,
    flow,
    id_of,
    step,
    transfer,
)


def test_heating_with_a_hold_ends_with_everything_off() -> None:
    params = {"temperature": "60 °C", "stir_speed": "400 rpm", "hold_for": "20 s"}
    plan = plan_of(a_bench(), flow(step("h", "heat_chill", vessel="@reactor", **params)))
    assert actions(plan) == ["stir", "heat_to", "hold", "stop_heating", "stop_stirring"]
    assert the_job(plan, "heat_to").args == {"temperature_c": 60.0, "tolerance_c": 1.0}
    assert the_job(plan, "hold").args["duration_s"] == 20.0
    assert all(id_of("reactor") in job.locks for job in plan.jobs)
    assert {job.recovery for job in plan.jobs} == {"R1"}
    assert the_job(plan, "heat_to").operation == Update(
        resource_id=id_of("heater_1"), data={"temperature_setpoint_c": 60.0}
    )


def test_a_device_of_two_nodes_heats_by_the_one_and_stirs_by_the_other() -> None:
    """heater ──thermal── pot ──mechanical── stirrer,  one device for both"""
    bench = a_bench()
    bench.add("own_heater", "heater")
    bench.add("own_stirrer", "stirrer")
    bench.vessel("pot")
    bench.tube("own_heater:", "pot:", medium=Medium.THERMAL)
    bench.tube("own_stirrer:", "pot:", medium=Medium.MECHANICAL)
    bench.device("plate", HEATER, {"heater": "own_heater", "stirrer": "own_stirrer"})
    params = {"temperature": "60 °C", "stir_speed": "400 rpm"}
    plan = plan_of(bench, flow(step("h", "heat_chill", vessel="@pot", **params)))
    acted = {job.action: job.operation for job in plan.jobs}
    assert acted == {
        "stir": Update(resource_id=id_of("own_stirrer"), data={"speed_setpoint_rpm": 400.0}),
        "heat_to": Update(resource_id=id_of("own_heater"), data={"temperature_setpoint_c": 60.0}),
    }


def test_heating_without_a_hold_leaves_the_heater_on() -> None:
    plan = plan_of(
        a_bench(), flow(step("h", "heat_chill", vessel="@reactor", temperature="333.15 K"))
    )
    assert actions(plan) == ["heat_to"]
    assert plan.jobs[0].args["temperature_c"] == pytest.approx(60.0)


@pytest.mark.parametrize(
    ("temperature", "code"), [("200 °C", "plan.out_of_range"), ("-20 °C", "driver.argument_range")]
)
def test_a_temperature_out_of_range_is_refused(temperature: str, code: str) -> None:
    value = flow(step("h", "heat_chill", vessel="@reactor", temperature=temperature))
    (finding,) = findings_of(a_bench(), value)
    assert (finding.code, finding.context["field"]) == (code, "params.temperature")


def test_a_vessel_on_no_heater_is_refused_and_a_coupled_one_is_not() -> None:
    bench = a_bench()
    value = flow(step("h", "heat_chill", vessel="@flask", temperature="60 °C"))
    assert codes_of(bench, value) == [("h", "plan.no_device")]
    bench.tube("heater_1:plate", "flask:base", medium=Medium.THERMAL)
    assert actions(plan_of(bench, value)) == ["heat_to"]


def test_a_vessel_with_two_heaters_is_refused_and_none_is_guessed() -> None:
    bench = a_bench()
    bench.add("heater_2", "heater_stirrer")
    bench.device("heater_2", HEATER, {"heater": "heater_2"})
    bench.tube("heater_2:plate", "reactor:base", medium=Medium.THERMAL)
    value = flow(step("h", "heat_chill", vessel="@reactor", temperature="60 °C"))
    assert codes_of(bench, value) == [("h", "plan.ambiguous_device")]


def test_stirring_for_a_time_ends_with_a_stop() -> None:
    params = {"stir_speed": "400 rpm", "duration": "1 min"}
    plan = plan_of(a_bench(), flow(step("s", "stir", vessel="@reactor", **params)))
    assert actions(plan) == ["stir", "wait", "stop_stirring"]
    assert id_of("heater_1") in the_job(plan, "wait").locks


def test_waiting_needs_a_timer() -> None:
    value = flow(step("w", "wait", duration="1 h"))
    plan = plan_of(a_bench(), value)
    assert plan.jobs[0].args == {"duration_s": 3600.0}
    assert plan.steps[0].estimate_s == 3600.0
    assert codes_of(Bench(), value) == [("w", "plan.no_device")]


def test_what_a_driver_does_not_allow_the_time_for_is_refused() -> None:
    value = flow(step("w", "wait", duration="2 h"))
    assert codes_of(a_bench(), value) == [("w", "plan.too_long")]


def test_measuring_reads_and_keeps_what_was_read() -> None:
    value = chain(
        step("m", "weigh", balance="@balance_1"), step("p", "measure_ph", transmitter="@ph_1")
    )
    mass, ph = plan_of(a_bench(), value).jobs
    assert mass.operation == Read(device_id=id_of("balance_1"), statuses=("mass_mg",))
    assert ph.operation == Read(device_id=id_of("ph_1"), statuses=("value_ph", "temperature_c"))
    assert id_of("flask") in mass.locks
    assert codes_of(a_bench(), flow(step("m", "weigh", balance="@heater_1"))) == [
        ("m", "plan.no_device")
    ]


def test_a_device_action_is_checked_against_its_driver() -> None:
    def call(action: str, **args: object) -> dict[str, Any]:
        return flow(step("d", "device_action", device="@valve_1", action=action, args=args))

    bench = a_bench()
    job = the_job(plan_of(bench, call("select_port", port_index=4)), "select_port")
    assert job.operation == Update(resource_id=id_of("valve_1"), data={"port_index": 4})
    assert codes_of(bench, call("explode")) == [("d", "driver.no_action")]
    assert codes_of(bench, call("select_port")) == [("d", "driver.argument_missing")]
    assert codes_of(bench, call("select_port", port_index=99)) == [("d", "driver.argument_range")]
    assert codes_of(bench, call("aspirate", volume_ul=1.0, rate_ul_s=1.0)) == [
        ("d", "plan.moves_liquid")
    ]


def test_zeroing_a_full_syringe_by_hand_is_refused_too() -> None:
    bench = a_bench(contents={LotId("water"): 1000})
    value = flow(step("d", "device_action", device="@pump_1", action="initialize"))
    assert codes_of(bench, value) == [("d", "plan.syringe_not_empty")]


def test_a_balance_with_another_name_for_its_node_is_found_by_its_resource() -> None:
    bench = a_bench()
    bench.devices = [d for d in bench.devices if d.key != "balance_1"]
    bench.device("scale", BALANCE, {"pan": "balance_1"})
    plan = plan_of(bench, flow(step("m", "weigh", balance="@balance_1")))
    assert plan.jobs[0].device_id == device_id_of("scale")


def test_what_the_review_of_a_device_promises_to_be_read_is_what_plans_read() -> None:
    heating = {"temperature": "60 °C", "stir_speed": "400 rpm", "hold_for": "20 s"}
    plans = [
        plan_of(a_bench(), flow(transfer("t", "water", "reactor", "5 mL"))),
        plan_of(a_bench(), flow(step("h", "heat_chill", vessel="@reactor", **heating))),
    ]
    read_before: dict[str, set[str]] = {}
    read_after: dict[str, set[str]] = {}
    for job in (job for plan in plans for job in plan.jobs):
        own = [one for one in job.post if not one.is_sensor]
        read_before.setdefault(job.action, set()).update(one.status for one in job.pre)
        read_after.setdefault(job.action, set()).update(one.status for one in own)
    assert {"aspirate", "dispense", "select_port", "heat_to", "hold", "stir"} <= set(read_after)
    for action, statuses in read_before.items():
        assert statuses == set(READ_BEFORE.get(action, ())), action
    for action, statuses in read_after.items():
        assert statuses == ({READ_AFTER[action]} if action in READ_AFTER else set()), action


@pytest.mark.parametrize("action", sorted(set(READ_AFTER) - {"aspirate", "dispense"}))
def test_each_action_of_the_table_has_a_condition_on_its_status(action: str) -> None:
    status = READ_AFTER[action]
    spec = DriverSpec(
        class_name="Any",
        module="",
        digest="",
        statuses=(StatusSpec(name=status, value=ParameterSpec(name=status, type="number")),),
    )
    device = AdmittedDevice(
        id=id_of("any"),
        key="any",
        name="Any",
        host_id=id_of("host"),
        spec=spec,
        transport="",
        config={},
        nodes={},
    )
    numbers = dict.fromkeys(("port_index", "temperature_c", "tolerance_c", "pressure_kpa"), 1.0)
    args = {**numbers, "tolerance_kpa": 1.0, "speed_rpm": 100.0}
    (condition,) = post_conditions(device, action, args)
    assert condition.status == status
