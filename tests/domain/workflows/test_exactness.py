from __future__ import annotations

from typing import Any

import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.errors import InfeasibleError
from labweb.domain.workflows.compile_workflow import check_plan, compile_workflow
from labweb.domain.workflows.passes.liquids.stroke_splitting import split_strokes
from tests.domain.workflows.asking import (
    read,
)
from tests.domain.workflows.bench import (
    Bench,
    chain,
    transfer,
)


@given(st.integers(1, 10**12), st.integers(1, 10**8))
def test_strokes_sum_up_are_few_and_differ_by_one_nanolitre_at_most(
    amount: int, syringe: int
) -> None:
    if amount // syringe > 10_000:
        return
    strokes = split_strokes(amount, syringe)
    assert sum(strokes) == amount
    assert len(strokes) == -(-amount // syringe)
    assert max(strokes) <= syringe
    assert max(strokes) - min(strokes) <= 1


@st.composite
def labs(draw: st.DrawFn) -> tuple[Bench, list[str]]:
    """Draw labs most of which can do what is asked: the rest is for the refusals."""
    bench = Bench()
    names = [f"v{n}" for n in range(draw(st.integers(2, 5)))]
    for name in names:
        bench.vessel(
            name,
            draw(st.integers(5_000_000, 40_000_000)),
            capacity_nl=draw(st.integers(60_000_000, 90_000_000)),
            dead_volume_nl=draw(st.sampled_from([0, 0, 500_000])),
        )
    for number in range(1, draw(st.integers(1, 3)) + 1):
        joined = draw(st.permutations(names))[draw(st.sampled_from([0, 0, 0, 1])) :]
        dead = st.none() | st.integers(0, 500_000)
        ports = {port: (name, draw(dead)) for port, name in enumerate(joined, start=1)}
        syringe_nl = draw(st.sampled_from([999_983, 1_000_000, 5_000_000, 25_000_000]))
        bench.pump(number, ports, syringe_nl=syringe_nl, ready=draw(st.booleans()))
    return bench, names


@settings(max_examples=150, deadline=None)
@given(labs(), st.data())
def test_every_planned_transfer_moves_exactly_what_was_asked(
    drawn: tuple[Bench, list[str]], data: st.DataObject
) -> None:
    bench, names = drawn
    steps = []
    wanted: list[tuple[str, str, int]] = []
    for place in range(data.draw(st.integers(1, 3))):
        source, target = data.draw(st.permutations(names))[:2]
        amount_nl = data.draw(st.integers(1, 12_000_000))
        steps.append(transfer(f"s{place}", source, target, f"{amount_nl} nL"))
        wanted.append((source, target, amount_nl))
    workflow = read(bench, chain(*steps))
    findings = check_plan(workflow, bench.view())
    event("refused" if findings else "planned")
    if findings:
        assert {f.subject for f in findings} <= {s["id"] for s in steps}
        with pytest.raises(InfeasibleError):
            compile_workflow(workflow, bench.view())
        return
    plan = compile_workflow(workflow, bench.view())
    level = {s.id: sum(s.contents.values()) for s in bench.states.values()}
    port: dict[Any, int] = {}
    tubes = {(c.source.resource_id, c.source.port): c.target.resource_id for c in bench.connections}
    moved = {f"s{place}": [0, 0] for place in range(len(wanted))}
    for job in plan.jobs:
        if job.action == "select_port":
            port[job.device_id] = job.args["port_index"]
        if not isinstance(job.operation, TransferLiquid):
            continue
        source_id, target_id = job.operation.source_id, job.operation.target_id
        amount = job.operation.amount_nl
        assert job.args["volume_ul"] * 1000 == pytest.approx(amount, abs=0.01)
        level[source_id] -= amount
        level[target_id] += amount
        capacity = bench.states[target_id].capacity_nl
        assert level[source_id] >= 0
        assert capacity is not None
        assert level[target_id] <= capacity
        is_draw = job.action == "aspirate"
        device = next(d for d in bench.devices if d.id == job.device_id)
        far = source_id if is_draw else target_id
        assert tubes[(device.nodes["valve"], str(port[job.device_id]))] == far
        moved[job.step_id][0 if is_draw else 1] += amount
    for place, (source, target, amount_nl) in enumerate(wanted):
        assert moved[f"s{place}"] == [amount_nl, amount_nl]
        assert source != target
    assert all(level[s.id] == 0 for s in bench.states.values() if s.kind == "syringe_pump")
