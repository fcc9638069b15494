"""A step that asks for a role under a place: who may do it, and what is approved with it."""

from __future__ import annotations

from dataclasses import replace
from uuid import UUID, uuid4

import msgspec
import pytest

from labweb.domain.approvals.approval_policy import TemperatureAtLeast, asks
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.runs.dispatch.job_scheduler import DeviceCandidate, JobView, ready, why_passed_by
from labweb.domain.runs.dispatch.work_of_absent_host import find_waiting
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.domain.runs.states.job_states import JobState
from labweb.domain.workflows.plan import Plan, encode
from tests.domain.workflows.asking import codes_of, findings_of, plan_of
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
)


def playing(spec: DriverSpec, *roles: str) -> DriverSpec:
    return msgspec.structs.replace(spec, roles=roles)


def a_lab() -> Bench:
    """Draw three balances, of which two stand on one bench.

    ::

        lab ── bench ── balance 2, balance 3 with a flask
          └─── balance 1, which stands beside
    """
    bench = Bench()
    bench.add("bench", "bench")
    for number, place in ((1, "lab"), (3, "bench"), (2, "bench")):
        key = f"balance_{number}"
        bench.add(key, "balance", on=place)
        bench.device(key, playing(BALANCE, "balance"), {"balance": key})
    bench.vessel("flask", on="balance_3", capacity_nl=50_000_000)
    return bench


WEIGH = step("w", "role_action", role="balance", under="@bench", action="weigh")


def test_each_device_of_the_role_under_the_place_may_do_it_in_the_order_of_their_keys() -> None:
    plan = plan_of(a_lab(), flow(WEIGH))
    (job,) = plan.jobs
    assert job.choices is not msgspec.UNSET
    assert [one.device_id for one in job.choices] == [
        device_id_of("balance_2"), device_id_of("balance_3")
    ]  # fmt: skip
    assert job.device_id == device_id_of("balance_2")
    assert id_of("flask") in job.choices[1].locks
    assert id_of("flask") not in job.choices[0].locks
    assert job.sentence == "Balance under Bench: weigh"
    assert plan.notes == (
        "weigh: the first of Balance 2, Balance 3 that is free when its turn comes",
    )


def test_a_plan_with_choices_reads_back_and_one_without_is_written_as_before() -> None:
    plan = plan_of(a_lab(), flow(WEIGH))
    assert msgspec.json.decode(encode(plan), type=Plan) == plan
    assert b"choices" not in encode(
        plan_of(a_lab(), flow(step("w", "weigh", balance="@balance_1")))
    )


def test_a_place_without_the_role_is_refused_with_the_roles_that_there_are() -> None:
    bench = a_lab()
    bench.add("shelf", "bench")
    value = flow({**WEIGH, "params": {**WEIGH["params"], "under": "@shelf"}})
    (finding,) = findings_of(bench, value)
    assert (finding.code, finding.context["field"]) == ("plan.no_device", "params.role")
    assert "no device under Shelf is a balance" in finding.message
    assert "the roles of this lab are balance" in finding.message


def test_a_device_that_cannot_do_it_is_left_out_with_the_reason() -> None:
    bench = a_lab()
    weighs = tuple(one for one in BALANCE.actions if one.name == "tare")
    bench.devices = [
        msgspec.structs.replace(one, spec=msgspec.structs.replace(one.spec, actions=weighs))
        if one.key == "balance_2"
        else one
        for one in bench.devices
    ]
    plan = plan_of(bench, flow(WEIGH))
    assert plan.jobs[0].device_id == device_id_of("balance_3")
    assert any(note.startswith("weigh: not Balance 2: ") for note in plan.notes)
    missing = {**WEIGH, "params": {**WEIGH["params"], "action": "dance"}}
    (finding,) = findings_of(bench, flow(missing))
    assert finding.code == "plan.no_device"
    assert "Balance 2: " in finding.message
    assert "Balance 3: " in finding.message


def test_what_moves_liquid_names_its_device() -> None:
    bench = a_bench()
    bench.devices = [
        msgspec.structs.replace(one, spec=playing(one.spec, "pump")) if one.key == "pump_1" else one
        for one in bench.devices
    ]
    params = {"role": "pump", "under": "@pump_1", "args": {}}
    for action, args in (("aspirate", {"volume_ul": 1.0, "rate_ul_s": 1.0}), ("initialize", {})):
        value = flow(step("p", "role_action", **{**params, "action": action, "args": args}))
        (finding,) = findings_of(bench, value)
        assert finding.code == "plan.no_device"
        assert "moves liquid" in finding.message or "name the device" in finding.message


def test_two_such_steps_need_no_order_and_one_beside_the_only_device_does() -> None:
    twice = flow(WEIGH, {**WEIGH, "id": "v"})
    assert len(plan_of(a_lab(), twice).jobs) == 2
    bench = a_lab()
    bench.devices = [one for one in bench.devices if one.key != "balance_3"]
    assert codes_of(bench, twice) == [("v", "protocol.unordered")]
    named = step("n", "weigh", balance="@balance_2")
    assert codes_of(bench, flow(WEIGH, named)) == [("n", "protocol.unordered")]
    assert len(plan_of(bench, chain(WEIGH, named)).jobs) == 2


def test_a_run_that_goes_to_its_hosts_whole_names_its_devices() -> None:
    value = flow(WEIGH)
    value["execution"] = {"on_disconnect": "continue", "max_offline_s": 60.0}
    assert codes_of(a_lab(), value) == [("w", "plan.role_in_batch")]


def test_a_policy_looks_at_every_way_in_which_it_may_be_done() -> None:
    bench = a_bench()
    bench.devices = [
        msgspec.structs.replace(one, spec=playing(HEATER, "heater_stirrer"))
        if one.key == "heater_1"
        else one
        for one in bench.devices
    ]
    args = {"temperature_c": 80.0, "tolerance_c": 1.0}
    under = {"role": "heater_stirrer", "under": "@heater_1", "action": "heat_to", "args": args}
    plan = plan_of(bench, flow(step("h", "role_action", **under)))
    (job,) = plan.jobs
    cool = msgspec.structs.replace(job, args={**job.args, "temperature_c": 20.0})
    assert asks(TemperatureAtLeast(temperature_c=60.0), msgspec.structs.replace(plan, jobs=(cool,)))


A, B = uuid4(), uuid4()
VIEW = JobView(
    id=UUID(int=1), index=0, state=JobState.QUEUED, after=(), host_id=A,
    choice_host_ids=frozenset({A, B}),
)  # fmt: skip


@pytest.mark.parametrize(("online", "count"), [({A}, 1), ({B}, 1), (set(), 0)])
def test_it_goes_while_one_of_its_hosts_is_online(online: set[UUID], count: int) -> None:
    assert len(ready([VIEW], online)) == count


def test_it_waits_for_a_host_that_is_away_only_when_no_other_is_there() -> None:
    away, there = SessionState.ISOLATED, SessionState.ONLINE
    assert find_waiting([VIEW], {A: away, B: there}).suspend == ()
    assert find_waiting([VIEW], {A: away, B: away}).suspend == (VIEW.id,)
    suspended = replace(VIEW, state=JobState.SUSPENDED)
    assert find_waiting([suspended], {A: away, B: there}).release == (VIEW.id,)
    assert find_waiting([suspended], {A: away, B: away}).release == ()


FREE = DeviceCandidate(
    state="enrolled", host_name="Host 1", is_host_online=True, is_on_planned_host=True, silent_s=1.0
)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({}, ""),
        ({"silent_s": None}, ""),
        ({"state": "suspended"}, "it is suspended"),
        ({"is_on_planned_host": False}, "it was taken to another host since this was planned"),
        ({"is_host_online": False}, "Host 1 is away"),
        ({"silent_s": 181.0}, "it has told nothing for minutes"),
    ],
)
def test_a_device_that_is_passed_by_says_why(change: dict[str, object], why: str) -> None:
    assert why_passed_by(replace(FREE, **change)) == why  # type: ignore[arg-type]
