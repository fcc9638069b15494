from __future__ import annotations

import pytest

from labweb.domain.workflows.compile_workflow import check_plan
from labweb.domain.workflows.plan import digest, encode
from labweb.domain.workflows.workflow_file import parse_workflow
from tests.domain.workflows.asking import (
    codes_of,
    findings_of,
    plan_of,
    read,
    the_job,
)
from tests.domain.workflows.bench import (
    a_bench,
    chain,
    device_id_of,
    flow,
    id_of,
    step,
    transfer,
)


def test_steps_that_share_something_without_an_order_are_refused() -> None:
    steps = (transfer("a", "water", "reactor", "1 mL"), transfer("b", "water", "flask", "1 mL"))
    (finding,) = findings_of(a_bench(), flow(*steps))
    assert (finding.subject, finding.code) == ("b", "protocol.unordered")
    assert finding.context["other"] == "a"
    assert "Water" in finding.context["shared"]
    assert plan_of(a_bench(), flow(*steps, edges=("b>a",))).steps[0].step_id == "b"


def test_weighing_a_flask_while_it_is_filled_is_unordered() -> None:
    value = flow(transfer("a", "water", "flask", "1 mL"), step("b", "weigh", balance="@balance_1"))
    assert codes_of(a_bench(), value) == [("b", "protocol.unordered")]


def test_steps_that_share_nothing_run_side_by_side() -> None:
    value = flow(
        transfer("a", "water", "flask", "1 mL"),
        step("b", "heat_chill", vessel="@reactor", temperature="60 °C"),
        step("c", "wait", duration="1 s"),
        edges=("a>c",),
    )
    plan = plan_of(a_bench(), value)
    assert the_job(plan, "heat_to").after == ()
    assert the_job(plan, "wait").after == (3,)


def test_two_waits_side_by_side_take_two_timers() -> None:
    value = flow(step("a", "wait", duration="1 s"), step("b", "wait", duration="2 s"))
    bench = a_bench()
    assert codes_of(bench, value) == [("b", "protocol.unordered")]
    bench.add("timer_2", "timer")
    bench.device("timer_2", bench.devices[-1].spec, {"timer": "timer_2"})
    plan = plan_of(bench, value)
    assert [job.device_id for job in plan.jobs] == [
        device_id_of("timer_1"),
        device_id_of("timer_2"),
    ]


def test_every_step_that_cannot_be_planned_is_told_at_once() -> None:
    value = chain(
        step("a", "heat_chill", vessel="@flask", temperature="60 °C"),
        transfer("b", "water", "reactor", "200 mL"),
        step("c", "weigh", balance="@timer_1"),
    )
    bench = a_bench()
    found = codes_of(bench, value)
    assert found == [
        ("a", "plan.no_device"),
        ("b", "crutd.capacity_exceeded"),
        ("c", "plan.no_device"),
    ]
    assert [f.code for f in check_plan(read(bench, value), bench.view())] == [c for _, c in found]


def test_a_syringe_is_never_where_liquid_comes_from_or_goes_to() -> None:
    value = flow(transfer("t", "water", "pump_1", "1 mL"))
    assert codes_of(a_bench(), value) == [("t", "plan.wrong_kind")]


def test_foreign_resources_unresolved_keys_and_strangers_are_refused() -> None:
    bench = a_bench()
    bench.add("alien", "foreign")
    assert codes_of(bench, flow(transfer("t", "alien", "flask", "1 mL"))) == [("t", "plan.foreign")]
    loose = parse_workflow(flow(transfer("t", "water", "flask", "1 mL")))
    assert {f.code for f in check_plan(loose, bench.view())} == {"protocol.unresolved_key"}
    stranger = flow(step("w", "weigh", balance=str(id_of("nobody"))))
    assert codes_of(bench, stranger) == [("w", "resource.not_found")]


def test_an_empty_workflow_is_no_plan() -> None:
    assert codes_of(a_bench(), flow()) == [("", "protocol.empty")]


def test_a_rate_faster_than_the_pump_is_refused() -> None:
    value = flow(transfer("t", "water", "reactor", "1 mL", flow_rate="60 mL/min"))
    assert plan_of(a_bench(), value).jobs[1].args["rate_ul_s"] == pytest.approx(1000.0)
    assert codes_of(a_bench(max_rate_ul_s=500.0), value) == [("t", "plan.too_fast")]


def test_a_port_the_valve_has_not_is_refused() -> None:
    value = flow(transfer("t", "water", "reactor", "1 mL"))
    assert codes_of(a_bench(ports_count=2), value) == [("t", "plan.no_such_port")]


def test_resource_and_driver_must_agree_on_the_syringe() -> None:
    value = flow(transfer("t", "water", "reactor", "1 mL"))
    assert codes_of(a_bench(syringe_ul=10_000.0), value) == [("t", "plan.syringe_disagrees")]


def test_the_same_question_gets_the_same_plan() -> None:
    value = chain(
        transfer("a", "water", "reactor", "7 mL"),
        step("b", "stop_heat_stir", vessel="@reactor"),
        step("c", "weigh", balance="@balance_1"),
    )
    bench = a_bench(ready=False)
    first = plan_of(bench, value)
    bench.connections.reverse()
    bench.devices.reverse()
    assert digest(plan_of(bench, value)) == digest(first)
    assert encode(first)


def test_material_edges_order_and_fill_the_steps() -> None:
    value = flow(
        step("h", "heat_chill", temperature="60 °C"),
        transfer("t", "water", "reactor", "5 mL"),
        edges=("t.target>h.vessel",),
    )
    plan = plan_of(a_bench(), value)
    assert [s.step_id for s in plan.steps] == ["t", "h"]
    assert plan.steps[1].sentence == "Bring Reactor to 60 °C"
