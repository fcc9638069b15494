from __future__ import annotations

import tracemalloc
from dataclasses import replace

import pytest

from labweb.domain.crutd.operations import TransferLiquid, Update, touched_ids
from labweb.domain.graph.ports_and_connections import PortRef
from labweb.domain.resources.contents_by_lot import LotId
from tests.domain.workflows.asking import (
    actions,
    codes_of,
    findings_of,
    moved_nl,
    plan_of,
)
from tests.domain.workflows.bench import (
    BARE_PUMP,
    VALVE,
    Bench,
    a_bench,
    chain,
    device_id_of,
    flow,
    id_of,
    step,
    transfer,
)


def test_a_transfer_turns_the_valve_draws_turns_it_and_pushes() -> None:
    plan = plan_of(a_bench(), flow(transfer("t", "water", "reactor", "5 mL")))
    assert actions(plan) == ["select_port", "aspirate", "select_port", "dispense"]
    assert [job.args.get("port_index") for job in plan.jobs] == [1, None, 3, None]
    assert [job.after for job in plan.jobs] == [(), (0,), (1,), (2,)]
    draw, push = plan.jobs[1], plan.jobs[3]
    assert draw.args == {"volume_ul": 5000.0, "rate_ul_s": 250.0}
    assert draw.operation == TransferLiquid(
        source_id=id_of("water"), target_id=id_of("pump_1"), amount_nl=5_000_000
    )
    assert push.operation == TransferLiquid(
        source_id=id_of("pump_1"), target_id=id_of("reactor"), amount_nl=5_000_000
    )
    assert plan.jobs[0].operation == Update(resource_id=id_of("valve_1"), data={"port_index": 1})
    assert draw.sentence == "Aspirate 5.00 mL from Water"
    assert plan.steps[0].sentence == "Transfer 5 mL from Water to Reactor"


def test_liquid_moves_only_with_the_valve_at_its_port_and_the_zero_known() -> None:
    plan = plan_of(a_bench(), flow(transfer("t", "water", "reactor", "5 mL")))
    for job, port, held_ul in ((plan.jobs[1], 1, 0.0), (plan.jobs[3], 3, 5000.0)):
        wanted = {c.status: c.low if c.equals is None else c.equals for c in job.pre}
        assert wanted == {"is_initialized": True, "port_index": port, "volume_ul": held_ul}
        assert {condition.device_id for condition in job.pre} == {device_id_of("pump_1")}


def test_after_each_stroke_the_plunger_must_stand_where_it_should() -> None:
    bench = a_bench(steps_full_count=1000)
    plan = plan_of(bench, flow(transfer("t", "water", "reactor", "2 mL")))
    (full,), (empty,) = plan.jobs[1].post, plan.jobs[3].post
    assert (full.status, full.low, full.high) == ("volume_ul", 2000.0, 2000.0)
    assert (empty.low, empty.high) == (0.0, 0.0)
    assert full.tolerance == 5.0
    coarse = plan_of(a_bench(steps_full_count=500), flow(transfer("t", "water", "flask", "2 mL")))
    assert coarse.jobs[1].post[0].tolerance == 10.0


def test_jobs_lock_the_device_the_vessel_and_the_valves_on_the_way() -> None:
    plan = plan_of(a_bench(), flow(transfer("t", "water", "reactor", "5 mL")))
    pump = {id_of("pump_1"), id_of("valve_1")}
    assert set(plan.jobs[0].locks) == pump
    assert set(plan.jobs[1].locks) == pump | {id_of("water")}
    assert set(plan.jobs[3].locks) == pump | {id_of("reactor")}
    assert all(set(touched_ids(job.operation)) <= set(job.locks) for job in plan.jobs)


def test_more_than_a_syringe_takes_equal_strokes() -> None:
    plan = plan_of(a_bench(), flow(transfer("t", "water", "reactor", "12.5 mL")))
    drawn = [j.args["volume_ul"] for j in plan.jobs if j.action == "aspirate"]
    assert drawn == [pytest.approx(4166.667), pytest.approx(4166.667), pytest.approx(4166.666)]
    assert moved_nl(plan, "water", "pump_1") == 12_500_000


def test_a_pump_without_a_zero_finds_it_once_before_everything_else() -> None:
    bench = a_bench(ready=False)
    value = chain(
        step("w", "wait", duration="1 s"),
        transfer("a", "water", "reactor", "1 mL"),
        transfer("b", "water", "flask", "1 mL"),
    )
    plan = plan_of(bench, value)
    assert actions(plan).count("initialize") == 1
    first = plan.jobs[0]
    assert (first.action, first.after, first.step_id) == ("initialize", (), "a")
    assert {c.status: c.equals for c in first.post if c.equals is not None} == {
        "is_initialized": True
    }
    assert [job.after for job in plan.jobs if job.step_id == "a"][1] == (0, 1)


def test_a_syringe_that_is_not_empty_is_neither_used_nor_zeroed() -> None:
    for ready, code in (
        (True, "plan.syringe_not_empty"),
        (False, "plan.not_initialized_with_liquid"),
    ):
        bench = a_bench(ready=ready, contents={LotId("water"): 1000})
        value = flow(transfer("t", "water", "reactor", "1 mL"))
        assert codes_of(bench, value) == [("t", code)]


def test_the_pump_that_wastes_least_is_taken_and_ties_go_to_the_first_key() -> None:
    def bench(dead_1: int, dead_2: int) -> Bench:
        drawn = Bench()
        drawn.vessel("water", 10_000_000)
        drawn.vessel("flask")
        drawn.pump(2, {1: ("water", dead_2), 2: ("flask", 0)})
        drawn.pump(1, {1: ("water", dead_1), 2: ("flask", 0)})
        return drawn

    value = flow(transfer("t", "water", "flask", "1 mL"))
    for dead, key in (((10, 20), "pump_1"), ((20, 10), "pump_2"), ((10, 10), "pump_1")):
        plan = plan_of(bench(*dead), value)
        assert {job.device_id for job in plan.jobs} == {device_id_of(key)}


def test_a_person_may_say_which_pump() -> None:
    bench = a_bench()
    bench.pump(2, {1: ("water", 900_000), 2: ("reactor", 0)})
    value = flow(transfer("t", "water", "reactor", "1 mL", pump="@pump_2"))
    assert {job.device_id for job in plan_of(bench, value).jobs} == {device_id_of("pump_2")}
    away = flow(transfer("t", "dye", "reactor", "1 mL", pump="@pump_2"))
    (finding,) = findings_of(bench, away)
    assert (finding.code, finding.context["field"]) == ("plan.no_route", "params.pump")


def test_a_transfer_that_needs_two_pumps_is_refused_and_says_where_it_breaks() -> None:
    # acid ── 1│valve 1│── pump 1      pump 2 ──│valve 2│1 ── vial
    # cup ─── 2│       │                        │       │2 ── cup
    bench = Bench()
    for key in ("acid", "cup", "vial"):
        bench.vessel(key, 10_000_000)
    bench.pump(1, {1: ("acid", 0), 2: ("cup", 0)})
    bench.pump(2, {1: ("vial", 0), 2: ("cup", 0)})
    (finding,) = findings_of(bench, flow(transfer("t", "acid", "vial", "1 mL")))
    assert (finding.subject, finding.code) == ("t", "plan.needs_relay")
    assert finding.context["pumps"] == ["pump_1", "pump_2"]
    assert finding.context["via"] == ["cup"]
    relayed = chain(transfer("a", "acid", "cup", "1 mL"), transfer("b", "cup", "vial", "1 mL"))
    assert moved_nl(plan_of(bench, relayed), "pump_2", "vial") == 1_000_000


def test_a_pump_that_nobody_drives_is_named() -> None:
    bench = a_bench()
    bench.vessel("island")
    bench.pump(2, {1: ("water", 0), 2: ("island", 0)})
    bench.devices.pop()
    (finding,) = findings_of(bench, flow(transfer("t", "water", "island", "1 mL")))
    assert (finding.code, finding.context["pumps"]) == ("plan.no_device", ["pump_2"])


def test_a_vessel_nobody_joined_is_refused_with_what_can_be_reached() -> None:
    bench = a_bench()
    bench.vessel("island")
    (finding,) = findings_of(bench, flow(transfer("t", "water", "island", "1 mL")))
    assert finding.code == "plan.no_route"
    assert finding.context["reaches_target"] == []
    assert "flask" in finding.context["reached"]


def test_a_lab_without_a_driven_pump_is_refused() -> None:
    bench = a_bench()
    bench.devices = [device for device in bench.devices if device.key != "pump_1"]
    value = flow(transfer("t", "water", "reactor", "1 mL"))
    assert codes_of(bench, value) == [("t", "plan.no_device")]


def test_a_valve_of_its_own_is_turned_by_its_own_device() -> None:
    bench = Bench()
    bench.vessel("water", 10_000_000)
    bench.vessel("flask")
    bench.pump(1, {1: ("water", 0), 2: ("flask", 0)})
    bench.devices.clear()
    bench.device("p", BARE_PUMP, {"pump": "pump_1"})
    bench.device("v", VALVE, {"valve": "valve_1"})
    plan = plan_of(bench, flow(transfer("t", "water", "flask", "1 mL")))
    turned = [device_id_of("v"), device_id_of("p")] * 2
    assert [job.device_id for job in plan.jobs] == turned
    bench.devices.pop()
    (finding,) = findings_of(bench, flow(transfer("t", "water", "flask", "1 mL")))
    assert finding.code == "plan.no_device"
    assert "Valve 1" in finding.message


def test_a_pump_with_two_tubes_and_no_valve_is_refused() -> None:
    bench = Bench()
    bench.vessel("water", 10_000_000)
    bench.vessel("flask")
    bench.add("pump_1", "syringe_pump", capacity_nl=5_000_000, data={"is_initialized": True})
    bench.tube("water:", "pump_1:a")
    bench.tube("pump_1:b", "flask:")
    bench.device("p", BARE_PUMP, {"pump": "pump_1"})
    value = flow(transfer("t", "water", "flask", "1 mL"))
    assert codes_of(bench, value) == [("t", "plan.ambiguous_port")]


def test_check_valves_make_a_pump_without_a_valve_sound() -> None:
    bench = Bench()
    bench.vessel("water", 10_000_000)
    bench.vessel("flask")
    bench.add("pump_1", "syringe_pump", capacity_nl=5_000_000, data={"is_initialized": True})
    bench.tube("water:", "pump_1:in", two_way=False)
    bench.tube("pump_1:out", "flask:", two_way=False)
    bench.device("p", BARE_PUMP, {"pump": "pump_1"})
    plan = plan_of(bench, flow(transfer("t", "water", "flask", "1 mL")))
    assert actions(plan) == ["aspirate", "dispense"]


def test_unknown_dead_volume_is_noted_for_the_reader() -> None:
    plan = plan_of(a_bench(), flow(transfer("t", "water", "flask", "1 mL")))
    assert len(plan.notes) == 1
    assert "unknown" in plan.notes[0]


def test_a_numbered_port_of_a_pump_is_not_taken_for_one_of_its_valve() -> None:
    # pump 1│1 ── common│valve 1│1 ── water, 2 ── flask
    bench = Bench()
    bench.vessel("water", 10_000_000)
    bench.vessel("flask")
    bench.pump(1, {1: ("water", 0), 2: ("flask", 0)})
    bench.connections[0] = replace(bench.connections[0], source=PortRef(id_of("pump_1"), "1"))
    plan = plan_of(bench, flow(transfer("t", "water", "flask", "1 mL")))
    assert actions(plan) == ["select_port", "aspirate", "select_port", "dispense"]
    assert [job.args.get("port_index") for job in plan.jobs] == [1, None, 2, None]
    bench.tube("pump_1:2", "flask:")
    value = flow(transfer("t", "water", "flask", "1 mL"))
    assert codes_of(bench, value) == [("t", "plan.no_device")]


def test_of_all_pairs_of_pumps_one_that_shares_a_vessel_is_named() -> None:
    # acid ── pump 1      acid, cup ── pump 2      cup, vial ── pump 3
    bench = Bench()
    for key in ("acid", "cup", "vial"):
        bench.vessel(key, 10_000_000)
    bench.pump(1, {1: ("acid", 0)})
    bench.pump(2, {1: ("acid", 0), 2: ("cup", 0)})
    bench.pump(3, {1: ("vial", 0), 2: ("cup", 0)})
    (finding,) = findings_of(bench, flow(transfer("t", "acid", "vial", "1 mL")))
    assert finding.context["pumps"] == ["pump_2", "pump_3"]
    assert finding.context["via"] == ["cup"]


def test_a_syringe_too_small_for_the_amount_is_chosen_last() -> None:
    bench = Bench()
    bench.vessel("water", 200_000_000)
    bench.vessel("flask")
    bench.pump(1, {1: ("water", 0), 2: ("flask", 0)}, syringe_nl=100_000)
    alone = flow(transfer("t", "water", "flask", "60 mL"))
    assert codes_of(bench, alone) == [("t", "plan.too_many_strokes")]
    bench.pump(2, {1: ("water", 900), 2: ("flask", 900)}, syringe_nl=5_000_000)
    assert moved_nl(plan_of(bench, alone), "pump_2", "flask") == 60_000_000
    small = flow(transfer("t", "water", "flask", "50 mL"))
    assert moved_nl(plan_of(bench, small), "pump_1", "flask") == 50_000_000


def test_a_volume_of_millions_of_strokes_is_refused_without_making_one() -> None:
    bench = Bench()
    bench.vessel("water", 200_000_000)
    bench.vessel("flask")
    bench.pump(1, {1: ("water", 0), 2: ("flask", 0)}, syringe_nl=100_000)
    tracemalloc.start()
    try:
        found = findings_of(bench, flow(transfer("t", "water", "flask", "1000 L")))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    (finding,) = [finding for finding in found if finding.code == "plan.too_many_strokes"]
    assert "10000000 strokes" in finding.message
    assert peak < 20_000_000
