from __future__ import annotations

from dataclasses import replace

import pytest

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.resources.contents_by_lot import LotId
from tests.domain.workflows.asking import actions, codes_of, findings_of, moved_nl, plan_of
from tests.domain.workflows.bench import (
    BARE_PUMP,
    Bench,
    a_bench,
    chain,
    device_id_of,
    flow,
    id_of,
    step,
    transfer,
)

WATER = {LotId("water"): 2_500_000}


def empty(step_id: str, pump: str, target: str, **more: str) -> dict[str, object]:
    return step(step_id, "empty_syringe", pump=f"@{pump}", target=f"@{target}", **more)


def test_a_syringe_is_emptied_in_one_stroke_of_all_that_the_record_says() -> None:
    held = {LotId("water"): 2_500_000, LotId("dye"): 1}
    plan = plan_of(a_bench(contents=held), flow(empty("e", "pump_1", "flask")))
    assert actions(plan) == ["select_port", "dispense"]
    turn, push = plan.jobs
    assert turn.args == {"port_index": 4}
    assert push.args == {"volume_ul": 2500.001, "rate_ul_s": 250.0}
    assert push.operation == TransferLiquid(
        source_id=id_of("pump_1"), target_id=id_of("flask"), amount_nl=2_500_001
    )
    assert (push.after, push.sentence) == ((0,), "Dispense 2.50 mL into Flask")
    assert plan.steps[0].sentence == "Empty the syringe of Pump 1 into Flask"
    assert len(plan.notes) == 1


def test_emptying_checks_what_every_dispense_checks() -> None:
    bench = a_bench(contents=WATER)
    (_, push) = plan_of(bench, flow(empty("e", "pump_1", "reactor"))).jobs
    wanted = {c.status: c.low if c.equals is None else c.equals for c in push.pre}
    assert wanted == {"is_initialized": True, "port_index": 3, "volume_ul": 2500.0}
    (after,) = push.post
    assert (after.status, after.low, after.high) == ("volume_ul", 0.0, 0.0)
    assert set(push.locks) == {id_of("pump_1"), id_of("valve_1"), id_of("reactor")}


def test_the_device_may_be_named_instead_of_its_syringe() -> None:
    value = flow(step("e", "empty_syringe", pump=str(device_id_of("pump_1")), target="@flask"))
    plan = plan_of(a_bench(contents=WATER), value)
    assert moved_nl(plan, "pump_1", "flask") == 2_500_000
    assert plan.steps[0].sentence == "Empty the syringe of Pump 1 into Flask"


def test_after_the_syringe_is_empty_a_transfer_goes_on_in_the_same_plan() -> None:
    bench = a_bench(contents=WATER)
    value = chain(empty("e", "pump_1", "flask"), transfer("t", "water", "reactor", "1 mL"))
    plan = plan_of(bench, value)
    assert "initialize" not in actions(plan)
    assert moved_nl(plan, "pump_1", "flask") == 2_500_000
    assert moved_nl(plan, "pump_1", "reactor") == 1_000_000
    (finding,) = findings_of(bench, flow(transfer("t", "water", "reactor", "1 mL")))
    assert finding.code == "plan.syringe_not_empty"
    assert "add a step 'Empty the syringe'" in finding.message


def test_what_was_emptied_is_there_for_later_steps() -> None:
    bench = a_bench(contents=WATER)
    value = chain(empty("e", "pump_1", "flask"), transfer("t", "flask", "reactor", "2.5 mL"))
    assert moved_nl(plan_of(bench, value), "pump_1", "reactor") == 2_500_000


def test_an_empty_syringe_is_not_emptied() -> None:
    value = flow(empty("e", "pump_1", "flask"))
    assert codes_of(a_bench(), value) == [("e", "plan.syringe_empty")]
    twice = chain(empty("a", "pump_1", "flask"), empty("b", "pump_1", "flask"))
    assert codes_of(a_bench(contents=WATER), twice) == [("b", "plan.syringe_empty")]


@pytest.mark.parametrize(
    "value",
    [
        flow(empty("s", "pump_1", "flask")),
        flow(transfer("s", "water", "reactor", "1 mL")),
        chain(empty("s", "pump_1", "flask"), transfer("t", "water", "reactor", "1 mL")),
        flow(step("s", "device_action", device="@pump_1", action="initialize")),
    ],
)
def test_a_pump_that_lost_its_zero_with_liquid_is_never_initialised(
    value: dict[str, object],
) -> None:
    (finding,) = findings_of(a_bench(ready=False, contents=WATER), value)
    assert (finding.subject, finding.code) == ("s", "plan.not_initialized_with_liquid")
    assert "2.50 mL" in finding.message
    assert "Take stock" in finding.message, "the way out has a name"


def test_a_target_without_room_is_told_at_the_target() -> None:
    bench = a_bench(contents=WATER)
    state = bench.states[id_of("flask")]
    bench.states[id_of("flask")] = replace(state, capacity_nl=1_000_000)
    (finding,) = findings_of(bench, flow(empty("e", "pump_1", "flask")))
    assert (finding.code, finding.context["field"]) == ("crutd.capacity_exceeded", "params.target")


def test_a_quarantined_syringe_is_not_emptied() -> None:
    bench = a_bench(contents=WATER)
    state = bench.states[id_of("pump_1")]
    bench.states[id_of("pump_1")] = replace(state, quarantined_by="tx-1")
    (finding,) = findings_of(bench, flow(empty("e", "pump_1", "flask")))
    assert (finding.code, finding.context["field"]) == ("crutd.quarantined", "params.pump")


def test_a_syringe_without_a_way_to_the_target_is_refused_and_nothing_else_is_judged() -> None:
    bench = a_bench(contents=WATER)
    bench.vessel("island")
    value = chain(
        empty("e", "pump_1", "island"),
        transfer("t", "water", "reactor", "1 mL"),
        transfer("u", "island", "flask", "1 mL"),
    )
    assert codes_of(bench, value) == [("e", "plan.no_route"), ("u", "plan.no_route")]


def test_only_a_driven_syringe_pump_can_be_emptied() -> None:
    bench = a_bench(contents=WATER)
    assert codes_of(bench, flow(empty("e", "balance_1", "flask"))) == [("e", "plan.no_device")]
    bench.devices = [device for device in bench.devices if device.key != "pump_1"]
    assert codes_of(bench, flow(empty("e", "pump_1", "flask"))) == [("e", "plan.no_device")]


def test_a_syringe_with_two_ways_out_and_no_valve_is_not_emptied() -> None:
    bench = Bench()
    bench.vessel("flask")
    bench.vessel("cup")
    zero = {"is_initialized": True}
    bench.add("pump_1", "syringe_pump", capacity_nl=5_000_000, data=zero, contents=WATER)
    bench.tube("pump_1:a", "flask:", two_way=False)
    bench.device("p", BARE_PUMP, {"pump": "pump_1"})
    value = flow(empty("e", "pump_1", "flask"))
    assert actions(plan_of(bench, value)) == ["dispense"]
    bench.tube("pump_1:b", "cup:")
    (finding,) = findings_of(bench, value)
    assert (finding.code, "where the liquid goes" in finding.message) == (
        "plan.ambiguous_port",
        True,
    )


def test_a_rate_may_be_stated_and_is_bounded() -> None:
    bench = a_bench(contents=WATER, max_rate_ul_s=300.0)
    slow = flow(empty("e", "pump_1", "flask", flow_rate="6 mL/min"))
    assert plan_of(bench, slow).jobs[-1].args["rate_ul_s"] == 100.0
    fast = flow(empty("e", "pump_1", "flask", flow_rate="60 mL/min"))
    assert codes_of(bench, fast) == [("e", "plan.too_fast")]


def test_emptying_and_a_transfer_of_the_same_pump_need_an_order() -> None:
    bench = a_bench(contents=WATER)
    value = flow(empty("e", "pump_1", "flask"), transfer("t", "water", "reactor", "1 mL"))
    assert ("t", "protocol.unordered") in codes_of(bench, value)
