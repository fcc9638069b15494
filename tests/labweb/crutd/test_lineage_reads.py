"""How lineage is read: as much as the walk asks for, in a number of queries that stays."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from django.db import connection
from django.test.utils import CaptureQueriesContext

from labweb.crutd import services
from labweb.crutd.models import Holding
from labweb.crutd.selectors import lineage
from labweb.domain.crutd.ledger import Account
from labweb.domain.crutd.operations import Correct, TransferLiquid
from labweb.domain.crutd.provenance.lineage import Limits, trace_up
from tests.builders import Bench

LIMITS = Limits(depth=lineage.DEEPEST, size=lineage.MOST_FLOWS)


def pour(bench: Bench, most_ml: int, *through: str) -> None:
    """Pour from each vessel into the next, a millilitre less each time: some cannot come out."""
    for step, (source, target) in enumerate(pairwise(through)):
        operation = TransferLiquid(
            source_id=bench.node(source).id,
            target_id=bench.node(target).id,
            amount_nl=(most_ml - step) * 1_000_000,
        )
        actor_id = bench.people["chemist"].pk
        services.carry_out(operation, lab=bench.lab, actor_id=actor_id)


def asked_of(bench: Bench, key: str) -> tuple[int, Sequence[str]]:
    """Return how many queries the lineage of a vessel costs, and the acts in it."""
    row = bench.node(key)
    with CaptureQueriesContext(connection) as queries:
        found = lineage.lineage(row, direction="up", depth=lineage.DEEPEST)
    return len(queries), [node["id"] for node in found["nodes"] if node["kind"] == "activity"]


def test_a_lineage_costs_the_same_queries_however_deep(bench: Bench) -> None:
    # water ──▶ flask_1
    pour(bench, 4, "water", "flask_1")
    shallow, acts = asked_of(bench, "flask_1")
    assert len(acts) == 1
    # water ──▶ flask_1 ──▶ flask_2 ──▶ reactor_1
    pour(bench, 3, "flask_1", "flask_2", "reactor_1")
    deep, acts = asked_of(bench, "reactor_1")
    assert len(acts) == 3
    assert deep == shallow


def test_what_is_read_ahead_is_what_each_step_would_read(bench: Bench) -> None:
    pour(bench, 4, "water", "flask_1", "flask_2", "reactor_1", "flask_1")
    pour(bench, 2, "dye", "flask_1", "flask_2")
    for key in ("flask_1", "flask_2", "reactor_1", "water", "waste"):
        row = bench.node(key)
        [found] = lineage.traces(row, direction="up", limits=LIMITS)
        assert found == trace_up(str(row.id), lineage.history, LIMITS)


def test_what_a_reaction_consumed_is_read_too(bench: Bench) -> None:
    # water ──▶ flask_1, where it turns into dye ──▶ flask_2
    pour(bench, 4, "water", "flask_1")
    dye = Holding.objects.get(resource=bench.node("dye")).lot_id
    reacted = Correct(
        resource_id=bench.node("flask_1").id,
        account=Account.REACTION,
        reason="all of it reacted",
        measured_nl={str(dye): 3_000_000},
    )
    services.carry_out(reacted, lab=bench.lab, actor_id=bench.people["chemist"].pk)
    pour(bench, 2, "flask_1", "flask_2")
    row = bench.node("flask_2")
    [found] = lineage.traces(row, direction="up", limits=LIMITS)
    assert found == trace_up(str(row.id), lineage.history, LIMITS)
    assert str(bench.node("water").id) in {flow.source for flow in found.flows}
