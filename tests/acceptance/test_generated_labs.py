"""Random transfers on labs by seed: the plan is right, or the refusal is."""

from __future__ import annotations

import itertools
import json
import os
import random
from collections.abc import Mapping
from typing import Any

import pytest

from labweb.domain.graph.lab_file.lab_json_read import read_lab
from tests.acceptance.asking import Refusal, Subject
from tests.acceptance.interpreter import Wanted, prove_plan
from tests.acceptance.plumbing import Plumbing
from tests.labs import generated_lab

SEEDS = range(1000 if os.environ.get("LABWEB_SOAK") else 20)
_PER_LAB = 12


LEAST_NL = 500_000
"""Sixty steps of a 25 mL syringe: less cannot be measured to a hundredth by every pump."""


def subject_of(seed: int) -> Subject:
    """Return the lab of a seed; every second one has a tube taken off and two check valves."""
    lab, dice = json.loads(generated_lab(seed)), random.Random(f"plumber {seed}")
    if seed % 2:
        lab["connections"].remove(dice.choice(lab["connections"]))
        for tube in dice.sample(lab["connections"], min(2, len(lab["connections"]))):
            tube["is_two_way"] = False
    return Subject(read_lab(json.dumps(lab).encode()))


def a_transfer(dice: random.Random, plumbing: Plumbing, step_id: str) -> Wanted:
    source, target = dice.sample(plumbing.vessels(), 2)
    most_nl = dice.choice((1_000_000, 30_000_000, 300_000_000))
    return Wanted(step_id, source, target, dice.randint(LEAST_NL, most_nl))


def moved(lab: Mapping[str, Any], want: Wanted) -> dict[str, Any]:
    """Return the lab file after a transfer, as far as totals tell it."""
    resources = [dict(entry) for entry in lab["resources"]]
    for entry in resources:
        sign = {want.source: -1, want.target: 1}.get(entry["key"])
        if sign:
            held = Plumbing(lab).held_nl(entry["key"]) + sign * want.amount_nl
            entry["contents"] = [{"lot": "any", "amount_ul": float(held) / 1000}] if held else []
    return {**lab, "resources": resources}


def relays(
    plumbing: Plumbing, want: Wanted, first: Mapping[str, Any], second: Mapping[str, Any]
) -> set[str]:
    """Return the vessels through which two pumps could do it in two transfers."""
    is_drawn = want.source in plumbing.joined(first, draws=True)
    is_pushed = want.target in plumbing.joined(second, draws=False)
    between = plumbing.joined(first, draws=False) & plumbing.joined(second, draws=True)
    return between - {want.source, want.target} if is_drawn and is_pushed else set()


def check_refusal(subject: Subject, refusal: Refusal, want: Wanted, reasons: set[str]) -> None:
    """Require that every reason is told at its step, and that a gap is where it is."""
    assert {finding.subject for finding in refusal.findings} == {want.step_id}, refusal
    assert refusal.codes == reasons, (want, refusal)
    plumbing = subject.plumbing
    names = {key: entry["name"] for key, entry in plumbing.resources.items()}
    pumps = {plumbing.pump_of(device): device for device in plumbing.pumps()}
    for finding in refusal.findings:
        if finding.code == "plan.no_route":
            ends = {finding.context["source"], finding.context["target"]}
            assert ends & {want.source, want.target}
            assert finding.context["target"] not in finding.context["reached"]
            assert finding.context["source"] not in finding.context["reaches_target"]
        if finding.code == "plan.needs_relay":
            first, second = (pumps[key] for key in finding.context["pumps"])
            assert want.source in plumbing.joined(first, draws=True)
            assert want.target in plumbing.joined(second, draws=False)
            assert set(finding.context["via"]) == relays(plumbing, want, first, second)
            if not finding.context["via"]:
                pairs = itertools.product(plumbing.pumps(), repeat=2)
                assert not any(relays(plumbing, want, *pair) for pair in pairs)
            assert names[want.source] in finding.message
            assert names[want.target] in finding.message


@pytest.mark.parametrize("seed", SEEDS)
def test_each_transfer_is_planned_right_or_refused_for_the_reason_that_is_there(seed: int) -> None:
    subject, dice = subject_of(seed), random.Random(seed)
    for number in range(_PER_LAB):
        want = a_transfer(dice, subject.plumbing, f"t{number}")
        reasons = subject.plumbing.reasons(want.source, want.target, want.amount_nl)
        answer = subject.ask([want])
        if isinstance(answer, Refusal):
            assert reasons, (want, answer)
            check_refusal(subject, answer, want, reasons)
        else:
            assert not reasons, (want, reasons)
            prove_plan(subject.file, answer, subject.keys, [want])


@pytest.mark.parametrize("seed", SEEDS)
def test_a_chain_is_planned_to_its_end_or_refused_at_the_step_that_breaks(seed: int) -> None:
    subject, dice = subject_of(seed), random.Random(f"chain {seed}")
    for _ in range(_PER_LAB // 2):
        wanted = [a_transfer(dice, subject.plumbing, f"t{number}") for number in range(4)]
        lab, broken = subject.file, None
        for want in wanted:
            if Plumbing(lab).reasons(want.source, want.target, want.amount_nl):
                broken = want
                break
            lab = moved(lab, want)
        answer = subject.ask(wanted)
        if isinstance(answer, Refusal):
            assert broken is not None, answer
            assert answer.findings[0].subject == broken.step_id
        else:
            assert broken is None
            prove_plan(subject.file, answer, subject.keys, wanted)


@pytest.mark.parametrize("seed", SEEDS)
def test_steps_side_by_side_come_out_the_same_in_every_order_or_are_refused(seed: int) -> None:
    subject, dice = subject_of(seed), random.Random(f"beside {seed}")
    made = [a_transfer(dice, subject.plumbing, f"t{number}") for number in range(40)]
    able = [w for w in made if not subject.plumbing.reasons(w.source, w.target, w.amount_nl)]
    for wanted in itertools.pairwise(able):
        answer = subject.ask(list(wanted), is_chain=False)
        if isinstance(answer, Refusal):
            assert "protocol.unordered" in answer.codes
        else:
            prove_plan(subject.file, answer, subject.keys, wanted)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_syringe_with_liquid_is_emptied_where_that_can_be_done(seed: int) -> None:
    lab, dice = subject_of(seed).file, random.Random(f"empty {seed}")
    pump = dice.choice(Subject(read_lab(json.dumps(lab).encode())).plumbing.pumps())["nodes"][
        "pump"
    ]
    entry = next(entry for entry in lab["resources"] if entry["key"] == pump)
    held_ul = dice.randint(1, entry["config"]["capacity_ul"])
    entry["data"] = {"is_initialized": True}
    entry["contents"] = [{"lot": lab["lots"][0]["key"], "amount_ul": held_ul}]
    subject = Subject(read_lab(json.dumps(lab).encode()))
    plumbing = subject.plumbing
    (device,) = [d for d in plumbing.pumps() if plumbing.pump_of(d) == pump]
    reached = plumbing.joined(device, draws=False)
    for target in plumbing.vessels():
        want = Wanted("e", pump, target, held_ul * 1000)
        params = {"pump": subject.ids[pump], "target": subject.ids[target]}
        step = {"id": "e", "kind": "empty_syringe", "params": params}
        document = {"schema": "labweb.workflow/1", "name": "Empty", "steps": [step], "edges": []}
        answer = subject.compile(document)
        free_nl = (plumbing.capacity_nl(target) or 0) - plumbing.held_nl(target)
        if isinstance(answer, Refusal):
            found = {"plan.no_route"} - {"plan.no_route" for _ in reached & {target}}
            found |= {"crutd.capacity_exceeded"} if free_nl < want.amount_nl else set()
            assert answer.codes == found, (want, answer)
        else:
            assert target in reached
            assert free_nl >= want.amount_nl
            prove_plan(subject.file, answer, subject.keys, [want])


def test_the_seeds_hold_what_can_be_done_and_each_reason_why_not() -> None:
    found: dict[str, int] = {}
    for seed in range(20):
        subject, dice = subject_of(seed), random.Random(seed)
        for number in range(_PER_LAB):
            want = a_transfer(dice, subject.plumbing, f"t{number}")
            reasons = subject.plumbing.reasons(want.source, want.target, want.amount_nl)
            for reason in reasons or {"done"}:
                found[reason] = found.get(reason, 0) + 1
    wanted = {"done", "plan.no_route", "plan.needs_relay", "crutd.insufficient_volume"}
    assert wanted <= found.keys(), found
    assert found["done"] >= 20
