from __future__ import annotations

import time
from typing import Any

from labweb.domain.errors import Finding
from tests.domain.workflows.asking import codes_of, findings_of, plan_of
from tests.domain.workflows.bench import Bench, a_bench, flow, step, transfer


def unordered(bench: Bench, value: dict[str, Any]) -> list[Finding]:
    return [f for f in findings_of(bench, value) if f.code == "protocol.unordered"]


def test_two_hundred_steps_without_connections_give_a_few_findings_that_group_them() -> None:
    kinds = [("water", "flask"), ("water", "reactor"), ("flask", "reactor")]
    steps = [transfer(f"t{n}", *kinds[n % 3], "0.1 mL") for n in range(200)]
    began = time.process_time()
    found = unordered(a_bench(), flow(*steps))
    assert 1 <= len(found) <= 20
    assert time.process_time() - began < 20
    first = found[0]
    assert first.message.startswith("200 steps use ")
    assert "nothing says in which order: steps 1 (t0), 2 (t1)" in first.message
    assert "and 195 more" in first.message
    assert first.context["steps"] == [f"t{n}" for n in range(200)]


def test_each_thing_is_named_with_the_steps_that_share_it() -> None:
    value = flow(
        step("h1", "heat_chill", vessel="@reactor", temperature="60 °C"),
        step("w1", "weigh", balance="@balance_1"),
        step("h2", "stop_heat_stir", vessel="@reactor"),
        step("w2", "weigh", balance="@balance_1"),
    )
    by_steps = {tuple(f.context["steps"]): f.context["shared"] for f in unordered(a_bench(), value)}
    assert set(by_steps) == {("h1", "h2"), ("w1", "w2")}
    assert "Reactor" in by_steps["h1", "h2"]
    assert "Balance 1" in by_steps["w1", "w2"]


def test_two_chains_that_share_a_pump_are_one_finding() -> None:
    first = [transfer(f"a{n}", "water", "flask", "0.1 mL") for n in range(5)]
    second = [transfer(f"b{n}", "water", "flask", "0.1 mL") for n in range(5)]
    edges = [f"{s}{n}>{s}{n + 1}" for s in "ab" for n in range(4)]
    (found,) = unordered(a_bench(), flow(*first, *second, edges=tuple(edges)))
    assert sorted(found.context["steps"]) == sorted(s["id"] for s in (*first, *second))
    plan_of(a_bench(), flow(*first, *second, edges=(*edges, "a4>b0")))


def test_branches_that_share_nothing_need_no_order() -> None:
    value = flow(
        transfer("a", "water", "flask", "1 mL"),
        step("b", "heat_chill", vessel="@reactor", temperature="60 °C"),
    )
    assert len(plan_of(a_bench(), value).steps) == 2


def test_steps_that_name_one_vessel_are_told_although_one_cannot_be_planned() -> None:
    value = flow(
        step("h", "heat_chill", vessel="@flask", temperature="60 °C"),
        transfer("t", "water", "flask", "1 mL"),
    )
    assert ("t", "protocol.unordered") in codes_of(a_bench(), value)


def test_many_separate_pairs_are_counted_after_the_first_twenty() -> None:
    bench = a_bench()
    steps = []
    for n in range(25):
        bench.add(f"vial_{n}", "vial", capacity_nl=10_000_000)
        steps += [
            step(f"h{n}", "stop_heat_stir", vessel=f"@vial_{n}"),
            step(f"s{n}", "stop_stir", vessel=f"@vial_{n}"),
        ]
    found = unordered(bench, flow(*steps))
    assert len(found) == 21
    assert found[-1].message.startswith("5 more groups of steps share something")
