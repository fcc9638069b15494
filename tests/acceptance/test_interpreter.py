"""The interpreter itself: it must find what is wrong, or it proves nothing."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import pytest

from labweb.domain.graph.lab_file.lab_json_read import read_lab
from tests.acceptance.asking import Refusal, Subject
from tests.acceptance.interpreter import Wanted, prove_plan
from tests.acceptance.plumbing import Wrong
from tests.labs import generated_lab

Plan = dict[str, Any]


def a_case() -> tuple[Subject, Plan, Wanted]:
    """Return a lab, a sound plan of several strokes, and what it does."""
    for seed in range(20):
        subject = Subject(read_lab(generated_lab(seed)))
        vessels = subject.plumbing.vessels()
        for source in vessels:
            for target in vessels:
                want = Wanted("t", source, target, 9_000_001)
                if not subject.plumbing.reasons(source, target, want.amount_nl):
                    answer = subject.ask([want])
                    assert not isinstance(answer, Refusal)
                    if sum(job["action"] == "aspirate" for job in answer["jobs"]) > 1:
                        return subject, answer, want
    raise AssertionError("no seed has such a lab")


def the(plan: Plan, action: str) -> list[dict[str, Any]]:
    return [job for job in plan["jobs"] if job["action"] == action]


def forget_a_turn(plan: Plan) -> None:
    turn = the(plan, "select_port")[-1]
    follower = plan["jobs"][turn["index"] + 1]
    follower["after"] = turn["after"]
    plan["jobs"].remove(turn)
    follower["pre"] = []


def turn_elsewhere(plan: Plan) -> None:
    turn = the(plan, "select_port")[-1]
    turn["args"]["port_index"] = turn["args"]["port_index"] % 9 + 1
    plan["jobs"][turn["index"] + 1]["pre"] = []


def lose_the_order(plan: Plan) -> None:
    for job in plan["jobs"]:
        job["after"] = []


def wait_in_a_ring(plan: Plan) -> None:
    plan["jobs"][0]["after"] = [plan["jobs"][-1]["index"]]


def draw_twice(plan: Plan) -> None:
    one, other = the(plan, "aspirate")[:2]
    other["args"]["volume_ul"] += one["args"]["volume_ul"]


def push_less(plan: Plan) -> None:
    push = the(plan, "dispense")[-1]
    push["args"]["volume_ul"] -= 1.0
    push["operation"]["amount_nl"] -= 1000


def claim_another_amount(plan: Plan) -> None:
    the(plan, "dispense")[0]["operation"]["amount_nl"] += 1


def forget_the_zero(plan: Plan) -> None:
    (zero,) = the(plan, "initialize")
    plan["jobs"].remove(zero)
    for job in plan["jobs"]:
        job["pre"] = []
        job["after"] = [index for index in job["after"] if index != zero["index"]]


def find_the_zero_late(plan: Plan) -> None:
    (zero,) = the(plan, "initialize")
    zero["after"] = [the(plan, "aspirate")[0]["index"]]
    for job in plan["jobs"]:
        if job is not zero:
            job["pre"] = []
            job["after"] = [index for index in job["after"] if index != zero["index"]]


def forget_a_lock(plan: Plan) -> None:
    the(plan, "aspirate")[0]["locks"] = []


def move_for_a_stranger(plan: Plan) -> None:
    for job in plan["jobs"]:
        job["step_id"] = "stranger"


SPOILERS: list[Callable[[Plan], None]] = [
    forget_a_turn,
    turn_elsewhere,
    lose_the_order,
    wait_in_a_ring,
    draw_twice,
    push_less,
    claim_another_amount,
    forget_the_zero,
    find_the_zero_late,
    forget_a_lock,
    move_for_a_stranger,
]


def test_a_sound_plan_is_proved() -> None:
    subject, plan, want = a_case()
    prove_plan(subject.file, plan, subject.keys, [want])


@pytest.mark.parametrize("spoil", SPOILERS)
def test_a_spoilt_plan_is_found_out(spoil: Callable[[Plan], None]) -> None:
    subject, plan, want = a_case()
    spoilt = copy.deepcopy(plan)
    spoil(spoilt)
    with pytest.raises(Wrong):
        prove_plan(subject.file, spoilt, subject.keys, [want])


def test_a_plan_for_another_amount_or_vessel_is_found_out() -> None:
    subject, plan, want = a_case()
    others = [Wanted("t", want.source, want.target, want.amount_nl + 1)]
    others += [Wanted("t", want.target, want.source, want.amount_nl)]
    for other in others:
        with pytest.raises(Wrong):
            prove_plan(subject.file, plan, subject.keys, [other])


@pytest.mark.parametrize("held_ul", [0.0, 1.0])
def test_a_vessel_that_runs_dry_or_over_is_found_out(held_ul: float) -> None:
    subject, plan, want = a_case()
    lab = copy.deepcopy(subject.file)
    entries = {entry["key"]: entry for entry in lab["resources"]}
    entries[want.source]["contents"] = [{"lot": "l", "amount_ul": held_ul}]
    with pytest.raises(Wrong, match="runs dry"):
        prove_plan(lab, plan, subject.keys, [want])
    lab = copy.deepcopy(subject.file)
    entries = {entry["key"]: entry for entry in lab["resources"]}
    entries[want.target]["config"]["capacity_ul"] = held_ul + 0.001
    with pytest.raises(Wrong, match="runs over"):
        prove_plan(lab, plan, subject.keys, [want])


def test_a_second_tube_at_a_valve_port_is_found_out() -> None:
    subject, plan, want = a_case()
    lab = copy.deepcopy(subject.file)
    tube = next(t for t in lab["connections"] if want.target in _ends(t))
    valve = tube["source"] if tube["target"]["resource"] == want.target else tube["target"]
    branch = {**tube, "key": "branch", "source": valve}
    branch["target"] = {"resource": want.source, "port": "elsewhere"}
    if len([t for t in lab["connections"] if want.target in _ends(t)]) == 1:
        lab["connections"].append(branch)
        with pytest.raises(Wrong, match="2 tubes"):
            prove_plan(lab, plan, subject.keys, [want])


def _ends(tube: dict[str, Any]) -> set[str]:
    return {tube["source"]["resource"], tube["target"]["resource"]}
