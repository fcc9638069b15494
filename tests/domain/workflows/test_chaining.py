"""Liquid goes along a backbone from syringe to syringe; both plungers of a pass move together.

::

    water ── 1│valve 1│6 ══ 6│valve 2│5 ══ 5│valve 3│1 ── flask
    reactor  2│       │     1│       │     2│       │ ── waste
              pump 1          pump 2          pump 3
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from uuid import UUID, uuid5

import pytest
from msgspec import UNSET
from msgspec.structs import replace as changed

from labweb.domain.crutd.operations import TransferLiquid, Update
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.workflows.plan import Plan, PlannedJob
from labweb.domain.workflows.plan_proof.prove_workflow import prove_plan
from labweb.domain.workflows.plan_proof.step_claims import NOT_PROVED
from tests.domain.workflows.asking import codes_of, findings_of, plan_of, read
from tests.domain.workflows.bench import BALANCE, SPACE, Bench, chain, flow, id_of, transfer

Mutant = Callable[[Plan], Plan]

ACROSS = flow(transfer("t", "water", "flask", "7 mL"))


def a_backbone() -> Bench:
    bench = Bench()
    bench.vessel("water", 50_000_000)
    for name in ("reactor", "flask", "waste"):
        bench.vessel(name)
    bench.pump(1, {1: ("water", 0), 2: ("reactor", 0)})
    bench.pump(2, {}, syringe_nl=2_000_000)
    bench.pump(3, {1: ("flask", 0), 2: ("waste", 0)})
    bench.tube("valve_1:6", "valve_2:6", 10)
    bench.tube("valve_2:5", "valve_3:5", 10)
    return bench


def moves(plan: Plan) -> list[str]:
    return [job.sentence for job in plan.jobs if job.action in {"aspirate", "dispense"}]


def test_three_syringes_pass_each_stroke_on() -> None:
    plan = plan_of(a_backbone(), ACROSS)
    assert moves(plan)[:6] == [
        "Aspirate 1.75 mL from Water, stroke 1 of 4",
        "Dispense 1.75 mL into Pump 2, stroke 1 of 4",
        "Aspirate 1.75 mL from Pump 1, stroke 1 of 4",
        "Dispense 1.75 mL into Pump 3, stroke 1 of 4",
        "Aspirate 1.75 mL from Pump 2, stroke 1 of 4",
        "Dispense 1.75 mL into Flask, stroke 1 of 4",
    ]
    assert len(moves(plan)) == 24


def test_the_two_plungers_of_a_pass_wait_for_the_same_and_what_follows_for_both() -> None:
    plan = plan_of(a_backbone(), ACROSS)
    pairs = [job for job in plan.jobs if job.receives]
    assert len(pairs) == 8
    for receiver in pairs:
        assert isinstance(receiver.meets, int)
        giver = plan.jobs[receiver.meets]
        assert giver.meets == receiver.index
        assert giver.after == receiver.after
        assert plan.jobs[receiver.index + 1].after == (giver.index, receiver.index)
        assert giver.args == receiver.args
        assert isinstance(giver.operation, TransferLiquid)
        assert receiver.operation == Update(resource_id=giver.operation.target_id, data={})
        assert not set(giver.locks).isdisjoint(receiver.locks)


def test_both_valves_are_turned_to_each_other_before_a_pass() -> None:
    plan = plan_of(a_backbone(), ACROSS)
    turned: dict[UUID, int] = {}
    seen = []
    for job in plan.jobs:
        if job.action == "select_port":
            turned[job.device_id] = job.args["port_index"]
        if job.receives:
            seen.append(sorted(turned.values()))
    assert seen[:2] == [[6, 6], [5, 5, 6]]


def test_a_single_pump_goes_before_a_chain() -> None:
    plan = plan_of(a_backbone(), flow(transfer("t", "water", "reactor", "1 mL")))
    assert [job for job in plan.jobs if job.receives] == []


def test_a_chain_moves_at_the_rate_of_its_slowest_pump() -> None:
    bench = a_backbone()
    plan = plan_of(bench, ACROSS)
    rates = {job.args["rate_ul_s"] for job in plan.jobs if "rate_ul_s" in job.args}
    assert rates == {100.0}  # 2 mL in 20 s


def test_pumps_of_two_hosts_are_no_chain() -> None:
    bench = a_backbone()
    bench.devices = [
        changed(one, host_id=uuid5(SPACE, "elsewhere")) if one.key == "pump_2" else one
        for one in bench.devices
    ]
    assert codes_of(bench, ACROSS) == [("t", "plan.needs_relay")]


def test_a_pump_that_the_step_names_is_not_helped_by_others() -> None:
    bench = a_backbone()
    pump = str(next(one.id for one in bench.devices if one.key == "pump_3"))
    (finding,) = findings_of(bench, flow(transfer("t", "water", "flask", "1 mL", pump=pump)))
    assert finding.context["field"] == "params.pump"


def test_every_syringe_of_a_chain_has_to_be_empty_and_gets_its_zero() -> None:
    bench = a_backbone()
    state = bench.states[id_of("pump_2")]
    bench.states[state.id] = replace(state, data={})
    plan = plan_of(bench, ACROSS)
    assert [job.sentence for job in plan.jobs if job.action == "initialize"] == [
        "Find the zero of Pump 2"
    ]
    bench.states[state.id] = replace(state, contents={LotId("water"): 100_000})
    assert codes_of(bench, ACROSS) == [("t", "plan.syringe_not_empty")]


def test_the_way_back_is_planned_after_the_way_there() -> None:
    bench = a_backbone()
    value = chain(transfer("a", "water", "flask", "3 mL"), transfer("b", "flask", "reactor", "all"))
    plan = plan_of(bench, value)
    assert prove_plan(read(bench, value), plan, bench.view()).findings == ()


def test_a_chain_is_proved() -> None:
    bench = a_backbone()
    proof = prove_plan(read(bench, ACROSS), plan_of(bench, ACROSS), bench.view())
    assert proof.findings == ()
    assert proof.covered == ("t",)


def _changed(place: int, **fields: object) -> Mutant:
    """Change the job at a place of the first pass: 0 gives, 1 receives."""

    def mutate(plan: Plan) -> Plan:
        jobs = list(plan.jobs)
        first = next(job.index for job in jobs if job.receives)
        index = first - 1 + place
        jobs[index] = changed(jobs[index], **fields)
        return changed(plan, jobs=tuple(jobs))

    return mutate


def _args(place: int, **args: object) -> Mutant:
    def mutate(plan: Plan) -> Plan:
        first = next(job.index for job in plan.jobs if job.receives)
        old = plan.jobs[first - 1 + place].args
        return _changed(place, args={**old, **args})(plan)

    return mutate


def _without(place: int) -> Mutant:
    def mutate(plan: Plan) -> Plan:
        first = next(job.index for job in plan.jobs if job.receives)
        jobs = [job for job in plan.jobs if job.index != first - 1 + place]
        return changed(plan, jobs=tuple(jobs))

    return mutate


def _alone(plan: Plan) -> Plan:
    jobs = tuple(changed(job, meets=UNSET) for job in plan.jobs)
    return changed(plan, jobs=jobs)


def _turned(device: str) -> Mutant:
    """Turn the last valve before the first pass one port off."""

    def mutate(plan: Plan) -> Plan:
        first = next(job.index for job in plan.jobs if job.receives)
        jobs: list[PlannedJob] = list(plan.jobs)
        index = max(
            job.index
            for job in jobs[:first]
            if job.action == "select_port" and device in job.sentence
        )
        port = jobs[index].args["port_index"] - 1
        jobs[index] = changed(jobs[index], args={"port_index": port})
        return changed(plan, jobs=tuple(jobs))

    return mutate


MUTANTS: dict[str, Mutant] = {
    "a pass of one plunger after the other": _alone,
    "the receiver draws less": _args(1, volume_ul=1000.0),
    "the receiver is slower": _args(1, rate_ul_s=50.0),
    "the giver pushes less": _args(0, volume_ul=1000.0),
    "no receiver": _without(1),
    "no giver": _without(0),
    "the valve of the giver stands elsewhere": _turned("Valve 1"),
    "the valve of the receiver stands elsewhere": _turned("Valve 2"),
    "the pass is booked into the third syringe": _changed(
        0,
        operation=TransferLiquid(
            source_id=id_of("pump_1"), target_id=id_of("pump_3"), amount_nl=1_750_000
        ),
    ),
    "the pass is booked from the flask": _changed(
        0,
        operation=TransferLiquid(
            source_id=id_of("flask"), target_id=id_of("pump_2"), amount_nl=1_750_000
        ),
    ),
    "the pass is not booked": _changed(0, operation=Update(resource_id=id_of("pump_2"), data={})),
}


@pytest.mark.parametrize("name", sorted(MUTANTS))
def test_a_fault_in_a_chain_is_refused_by_the_proof(name: str) -> None:
    bench = a_backbone()
    plan = MUTANTS[name](plan_of(bench, ACROSS))
    findings = prove_plan(read(bench, ACROSS), plan, bench.view()).findings
    assert {one.code for one in findings} == {NOT_PROVED}
    assert findings[0].subject == "t"


def test_only_what_leaves_the_last_syringe_arrives_on_a_balance() -> None:
    bench = Bench()
    bench.add("balance_1", "balance")
    bench.vessel("water", 50_000_000)
    bench.vessel("flask", on="balance_1")
    bench.pump(1, {1: ("water", 0)})
    bench.pump(2, {1: ("flask", 0)})
    bench.tube("valve_1:6", "valve_2:6", 10)
    bench.device("balance_1", BALANCE, {"balance": "balance_1"})
    value = flow(transfer("t", "water", "flask", "1 mL", confirm_with="@balance_1"))
    plan = plan_of(bench, value)
    weighed = [job.sentence for job in plan.jobs if any("mass" in one.name for one in job.post)]
    assert weighed == ["Dispense 1.00 mL into Flask"]


def test_liquid_goes_by_the_port_that_is_asked_for_or_not_at_all() -> None:
    bench = Bench()
    bench.vessel("water", 50_000_000)
    bench.vessel("flask")
    bench.pump(1, {1: ("water", 0)})
    bench.tube("valve_1:2", "flask:top", 10)
    bench.tube("valve_1:3", "flask:side", 500)
    for port, turned in (("top", 2), ("side", 3)):
        document = flow(transfer("t", "water", "flask", "1 mL", target_port=port))
        plan = plan_of(bench, document)
        turns = [job.args["port_index"] for job in plan.jobs if job.action == "select_port"]
        assert turns == [1, turned]
        assert prove_plan(read(bench, document), plan, bench.view()).findings == ()
    for name, port in (("target_port", "bottom"), ("source_port", "top")):
        document = flow(transfer("t", "water", "flask", "1 mL", **{name: port}))
        assert codes_of(bench, document) == [("t", "plan.unknown_port")]


@pytest.mark.parametrize(
    ("near", "far"),
    [("valve_1:4", "valve_2:4"), ("valve_2:3", "valve_3:4"), ("valve_3:3", "flask:top")],
)
def test_a_chain_goes_once_through_the_cartridge_that_is_asked_for(near: str, far: str) -> None:
    """Between two syringes as well as before the flask."""
    bench = a_backbone()
    bench.vessel("salt", kind="cartridge")
    bench.tube(near, "salt:in", 10)
    bench.tube("salt:out", far, 10)
    document = flow(transfer("t", "water", "flask", "1 mL", through="@salt"))
    plan = plan_of(bench, document)
    ends = [int(end.rpartition(":")[2]) for end in (near, far) if end.startswith("valve")]
    turned = [job.args["port_index"] for job in plan.jobs if job.action == "select_port"]
    assert set(ends) <= set(turned)
    assert len(moves(plan)) % 3 == 0
    proof = prove_plan(read(bench, document), plan, bench.view())
    assert (proof.findings, proof.covered) == ((), ("t",))
