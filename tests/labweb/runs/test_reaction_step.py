"""A step of a workflow that ends in a reaction: planned, run by a host, on record, traced back.

```text
acid ──▶ jar ──▶ REACTION ──▶ jar: salt-1
base ──▶
```
"""

from __future__ import annotations

from typing import Any

import pytest

from labweb.crutd.models import Entry
from labweb.crutd.selectors.history_replay import rebuild_differences
from labweb.crutd.selectors.ledger_verification import ledger_violations
from labweb.domain.errors import InfeasibleError, ProtocolError
from labweb.records.selectors import provenance
from labweb.resources.models import Lot
from labweb.runs import services as run_services
from labweb.runs.models import Run
from labweb.workflows import services as workflow_services
from tests.builders import Bench, an_edge, dispatched
from tests.labweb.crutd.hand import a_jar, delivery, done, held, material, node, solid

REACT = {
    "duration": "10 s",
    "consumed": {"acid-1": "40 uL", "base-1": "48 mg"},
    "product": "salt-1",
    "material": "salt",
    "mass": "90 mg",
    "residue": "6 mg",
    "reason": "yield of the last three batches",
}


@pytest.fixture
def jar(bench: Bench) -> Bench:
    """Put 1 mL of acid (1.2 mg/µL) and 50 mg of base into a jar."""
    a_jar(bench, "jar")
    material(bench, density_mg_ul=1.2)
    material(bench, key="salt", name="Salt")
    done(bench, delivery(bench, "jar", key="acid-1"))
    done(bench, solid(bench, "jar", 50_000, key="base-1"))
    return bench


def started(bench: Bench, **params: Any) -> Run:  # noqa: ANN401 - parameters of a step
    chosen = {"vessel": node(bench, "jar"), **REACT, **params}
    step = {"id": "r", "kind": "react", "params": {k: v for k, v in chosen.items() if v != ""}}
    step["position"] = {"x": 0, "y": 0}
    document = {"schema": "labweb.workflow/1", "name": "Salt", "steps": [step], "edges": []}
    chemist = bench.people["chemist"]
    workflow = workflow_services.create_workflow(
        bench.lab, name="Salt", document=document, actor=chemist
    )
    version = workflow_services.save_version(workflow.id, note="", actor=chemist)
    return run_services.start_run(version, actor=chemist)


def test_a_step_that_has_run_leaves_a_product_lot_and_its_way_back(jar: Bench) -> None:
    before = held(jar, "jar")
    edge = an_edge(jar)
    run = started(jar)
    edge.work_off(run)
    run.refresh_from_db()
    assert (run.state, [job.state for job in run.jobs.all()]) == ("complete", ["complete"])
    after = held(jar, "jar")
    assert before["acid-1"][0] - after["acid-1"][0] == 40_000
    assert before["base-1"][1] - after["base-1"][1] == 48_000
    assert after["salt-1"] == (0, 90_000)
    job = run.jobs.get()
    entries = Entry.objects.filter(transaction__job_id=job.id, state="posted")
    assert entries.filter(credit="REACTION").count() == 2
    assert entries.filter(debit="REACTION", lot__key="salt-1").count() == 1
    assert Lot.objects.get(key="salt-1").material.key == "salt"
    assert ledger_violations(jar.lab) == []
    assert rebuild_differences(jar.lab) == []


def test_the_product_leads_back_to_the_lots_of_its_reactants(jar: Bench) -> None:
    an_edge(jar).work_off(started(jar))
    lots = {row.key: f"lot/{row.id}" for row in Lot.objects.all()}
    found = provenance.of_lot(Lot.objects.get(key="salt-1"), direction="up", depth=10).graph
    derived = {(r.later, r.earlier) for r in found.relations if r.bond.value == "wasDerivedFrom"}
    wanted = {(lots["salt-1"], lots["acid-1"]), (lots["salt-1"], lots["base-1"])}
    assert wanted <= derived
    assert "run" in {node.type for node in found.nodes.values()}


def test_a_reaction_that_was_broken_off_closes_its_vessel(jar: Bench) -> None:
    edge = an_edge(jar)
    attempt = dispatched(started(jar))
    before = held(jar, "jar")
    edge.lose(attempt)
    assert jar.node("jar").quarantined_by == attempt.transaction_id
    assert held(jar, "jar") == before
    assert not Lot.objects.filter(key="salt-1").exists()


@pytest.mark.parametrize(
    ("params", "code"),
    [
        ({"residue": ""}, "crutd.mass_not_conserved"),
        ({"consumed": {"acid-1": "40 uL", "base-1": "51 mg"}}, "crutd.insufficient_mass"),
        ({"consumed": {"acid-1": "40 uL", "other": "48 mg"}}, "plan.no_lot"),
        ({"consumed": {"acid-1": "40 mg", "base-1": "48 mg"}}, "unit.unknown"),
        ({"consumed": {"acid-1": "", "base-1": "48 mg"}}, "unit.not_text"),
        ({"consumed": {}}, "plan.no_reactant"),
        ({"material": "gold"}, "plan.no_material"),
        ({"product": "acid-1"}, "crutd.lot_taken"),
        ({"volume": "1 mL"}, "plan.product_amount"),
        ({"mass": ""}, "plan.product_amount"),
        ({"mass": "0.0001 mg"}, "unit.off_grid"),
    ],
)
def test_what_cannot_be_so_is_refused_before_anything_runs(
    jar: Bench, params: dict[str, Any], code: str
) -> None:
    with pytest.raises((InfeasibleError, ProtocolError)) as refusal:
        started(jar, **params)
    assert code in {finding.code for finding in refusal.value.findings}
    assert not Run.objects.exists()


def test_two_steps_cannot_make_the_same_lot(jar: Bench) -> None:
    an_edge(jar).work_off(started(jar))
    with pytest.raises(InfeasibleError) as refusal:
        started(jar)
    assert refusal.value.code == "crutd.lot_taken"
