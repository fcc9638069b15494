"""A thing that a device carries stands elsewhere for every later step of the plan."""

from __future__ import annotations

from typing import Any

import pytest

from labweb.domain.crutd.operations import TransferResource
from labweb.domain.enrollment.driver_spec import ActionSpec, DriverSpec
from labweb.domain.graph.ports_and_connections import Medium
from tests.domain.workflows.asking import codes_of, findings_of, plan_of, the_job
from tests.domain.workflows.bench import Bench, a_bench, chain, flow, id_of, step

ARM = DriverSpec(
    class_name="Arm",
    module="",
    digest="0" * 64,
    actions=(
        ActionSpec(name="run_program", role="arm", timeout_s=30.0),
        ActionSpec(name="stop_program", role="arm"),
    ),
)


def carry(to: str, number: int = 1, /, **changes: Any) -> dict[str, Any]:  # noqa: ANN401
    params = {"resource": "@rack", "place": f"@{to}", "device": "@arm", "action": "run_program"}
    return step(f"c{number}", "carry", **params | changes)


@pytest.fixture
def lab() -> Bench:
    bench = a_bench()
    bench.add("rack", "tube_rack")
    bench.vessel("tube", kind="vial", on="rack")
    bench.add("bench_9", "bench")
    bench.stand("reactor", "bench_9")
    bench.add("arm", "workstation")
    bench.device("arm", ARM, {"arm": "arm"})
    return bench


def test_a_carry_is_one_job_that_moves_the_record(lab: Bench) -> None:
    job = the_job(plan_of(lab, flow(carry("bench_9"))), "run_program")
    ends = {"from_id": id_of("lab"), "to_id": id_of("bench_9")}
    assert job.operation == TransferResource(resource_id=id_of("rack"), **ends)
    assert set(job.locks) == {id_of("rack"), id_of("arm")}
    assert (job.estimate_s, job.recovery) == (30.0, "R3")


def test_later_steps_find_it_where_it_was_put(lab: Bench) -> None:
    heat = step("h", "heat_chill", vessel="@tube", temperature="40 °C")
    assert codes_of(lab, flow(heat)) == [("h", "plan.no_device")]
    plan = plan_of(lab, chain(carry("heater_1"), heat, carry("bench_9", 2)))
    assert [job.action for job in plan.jobs] == ["run_program", "heat_to", "run_program"]
    last = plan.jobs[-1].operation
    assert isinstance(last, TransferResource)
    assert last.from_id == id_of("heater_1")


@pytest.mark.parametrize(
    ("to", "changes", "code", "field"),
    [
        ("lab", {}, "plan.there_already", "params.place"),
        ("rack", {}, "crutd.into_itself", "params.place"),
        ("tube", {}, "crutd.into_itself", "params.place"),
        ("bench_9", {"resource": "@heater_1"}, "plan.wrong_kind", "params.resource"),
        ("bench_9", {"device": "@rack"}, "plan.no_device", "params.device"),
        ("bench_9", {"action": "explode"}, "driver.no_action", "params.action"),
        ("bench_9", {"action": "stop_program"}, "plan.not_carrying", "params.action"),
    ],
)
def test_what_cannot_be_carried_so_is_refused(
    lab: Bench, to: str, changes: dict[str, str], code: str, field: str
) -> None:
    (finding,) = findings_of(lab, flow(carry(to, 1, **changes)))
    assert (finding.subject, finding.code, finding.context["field"]) == ("c1", code, field)


@pytest.mark.parametrize(
    ("to", "kind", "there", "code"),
    [
        ("slot_9", "slot", "vial", "place.occupied"),
        ("pan_9", "balance", "vial", "place.occupied"),
        ("plate_9", "plate", "", "place.wrong_kind"),
        ("deck_9", "deck", "", "place.wrong_kind"),
    ],
)
def test_a_carry_to_where_there_is_no_room_is_refused_when_it_is_planned(
    lab: Bench, to: str, kind: str, there: str, code: str
) -> None:
    lab.add(to, kind)
    if there:
        lab.vessel("other", kind=there, on=to)
    (finding,) = findings_of(lab, flow(carry(to)))
    assert (finding.code, finding.context["field"]) == (code, "params.place")


def test_the_second_of_two_carries_to_one_slot_is_refused_and_not_once_the_first_has_left(
    lab: Bench,
) -> None:
    lab.add("slot_9", "slot")
    lab.add("plate_9", "plate")
    second = carry("slot_9", 2, resource="@plate_9")
    assert codes_of(lab, chain(carry("slot_9"), second)) == [("c2", "place.occupied")]
    away = carry("bench_9", 3)
    assert len(plan_of(lab, chain(carry("slot_9"), away, second)).jobs) == 3


def test_what_is_connected_is_refused_by_name_and_what_only_stands_is_not(lab: Bench) -> None:
    lab.tube("tube:a", "bench_9:b", medium=Medium.MECHANICAL)
    assert len(plan_of(lab, flow(carry("bench_9"))).jobs) == 1
    lab.tube("tube:a", "flask:b", medium=Medium.GAS)
    (finding,) = findings_of(lab, flow(carry("bench_9")))
    assert (finding.code, finding.context["field"]) == ("crutd.connected", "params.resource")
    assert "(gas)" in finding.message


def test_two_carries_of_one_thing_need_an_order(lab: Bench) -> None:
    value = flow(carry("bench_9"), carry("heater_1", 2))
    assert ("c2", "protocol.unordered") in codes_of(lab, value)


def test_carrying_a_rack_and_stirring_a_tube_in_it_need_an_order(lab: Bench) -> None:
    stop = step("s", "stop_stir", vessel="@tube")
    assert ("s", "protocol.unordered") in codes_of(lab, flow(carry("bench_9"), stop))


def test_a_carry_needs_no_order_with_what_else_stands_in_the_lab(lab: Bench) -> None:
    lab.stand("reactor", "heater_1")
    stir = step("s", "stir", vessel="@reactor", stir_speed="300 rpm", duration="1 min")
    assert len(plan_of(lab, flow(carry("bench_9"), stir)).steps) == 2
