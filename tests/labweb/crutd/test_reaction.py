"""A reaction on record: lots go, a product comes, and the way back is known.

```text
acid ──▶ flask_1 ──▶ REACTION ──▶ flask_1: salt
base ──▶
```
"""

from __future__ import annotations

from typing import Any
from uuid import uuid4

import pytest

from labweb.crutd.selectors.lineage import lineage
from labweb.domain.crutd.provenance.prov_check import check_prov
from labweb.domain.crutd.provenance.prov_json_read import read_prov
from labweb.records.selectors import provenance
from labweb.resources.models import Lot, Material
from tests.builders import Bench, a_user
from tests.labweb.crutd.hand import a_jar, delivery, done, held, material, node, refused, solid
from tests.labweb.web import call, read, signed_in


@pytest.fixture
def reaction(bench: Bench) -> dict[str, Any]:
    """Put 1 mL of acid (1.2 mg/µL) and 50 mg of base into a jar; return what became of them."""
    material(bench, density_mg_ul=1.2)
    a_jar(bench, "jar")
    liquid = delivery(bench, "jar", key="acid-1")
    done(bench, liquid)
    base = solid(bench, "jar", 50_000, key="base-1")
    done(bench, base)
    salt = material(bench, key="salt", name="Salt")
    return {
        "op": "react",
        "resource_id": node(bench, "jar"),
        "reactants": [
            {"lot_id": liquid["lot_id"], "amount_nl": 40_000},
            {"lot_id": base["lot_id"], "amount_ug": 48_000},
        ],
        "products": [
            {
                "lot_id": str(uuid4()),
                "material_id": str(salt.id),
                "key": "salt-1",
                "phase": "solid",
                "amount_ug": 90_000,
            }
        ],
        "residue_ug": 6_000,
        "reason": "weighed after drying",
    }


def test_reactants_go_and_a_product_lot_comes(bench: Bench, reaction: dict[str, Any]) -> None:
    """`done` looks at the ledger and replays the events."""
    told = done(bench, reaction)
    assert held(bench, "jar") == {
        "acid-1": (960_000, 0),
        "base-1": (0, 2_000),
        "salt-1": (0, 90_000),
    }
    assert told["summary"] == "Jar: made salt-1; weighed after drying"
    lot = Lot.objects.get(key="salt-1")
    assert (lot.material.name, lot.phase, lot.supplier) == ("Salt", "solid", "")


def test_masses_that_do_not_agree_change_nothing(bench: Bench, reaction: dict[str, Any]) -> None:
    told = refused(bench, {**reaction, "residue_ug": 0}, "crutd.mass_not_conserved")
    assert "96 mg were consumed, 90 mg are told as made" in told["message"]
    heavier = [{**reaction["products"][0], "amount_ug": 97_000}]
    refused(bench, {**reaction, "products": heavier}, "crutd.mass_not_conserved")


def test_a_product_is_a_new_lot(bench: Bench, reaction: dict[str, Any]) -> None:
    half = {
        "reactants": [
            {**reaction["reactants"][0], "amount_nl": 20_000},
            {**reaction["reactants"][1], "amount_ug": 24_000},
        ],
        "products": [{**reaction["products"][0], "amount_ug": 45_000}],
        "residue_ug": 3_000,
    }
    reaction |= half
    done(bench, reaction)
    refused(bench, reaction, "crutd.lot_taken")
    same_key = [{**reaction["products"][0], "lot_id": str(uuid4())}]
    refused(bench, {**reaction, "products": same_key}, "crutd.lot_taken")


def test_a_density_that_nobody_stated_asks_for_the_mass(
    bench: Bench, reaction: dict[str, Any]
) -> None:
    Material.objects.filter(key="acid").update(density_mg_ul=None)
    refused(bench, reaction, "crutd.unknown_density")
    reaction["reactants"][0]["mass_ug"] = 48_000
    done(bench, reaction)


def test_a_product_leads_back_to_its_reactants(bench: Bench, reaction: dict[str, Any]) -> None:
    done(bench, reaction)
    lot = Lot.objects.get(key="salt-1")
    found = provenance.of_lot(lot, direction="up", depth=10)
    lots = {node.id for node in found.graph.nodes.values() if node.type == "lot"}
    reactants = {f"lot/{share['lot_id']}" for share in reaction["reactants"]}
    assert lots == reactants | {f"lot/{lot.id}"}
    derived = {
        (r.later, r.earlier) for r in found.graph.relations if r.bond.value == "wasDerivedFrom"
    }
    assert {(f"lot/{lot.id}", reactant) for reactant in reactants} <= derived
    client = signed_in(bench.people["observer"])
    answer = call(client, "GET", f"/api/v1/lots/{lot.id}/provenance?direction=up&form=prov")
    assert check_prov(read_prov(answer.content)) == []


def test_a_reactant_leads_to_the_product_and_where_it_went(
    bench: Bench, reaction: dict[str, Any]
) -> None:
    done(bench, reaction)
    a_jar(bench, "vial")
    away = {"op": "dispose", "resource_id": node(bench, "jar"), "amount_nl": None}
    base = Lot.objects.get(key="base-1")
    down = provenance.of_lot(base, direction="down", depth=10)
    assert "Salt" in {n.name for n in down.graph.nodes.values() if n.type == "lot"}
    done(bench, away)
    after = provenance.of_resource(bench.node("jar"), direction="up", depth=10)
    assert {"Salt"} <= {n.name for n in after.graph.nodes.values() if n.type == "lot"}
    drawn = lineage(bench.node("jar"), direction="up", depth=5)
    act = next(n["id"] for n in drawn["nodes"] if n["kind"] == "activity")
    salt = f"lot:{Lot.objects.get(key='salt-1').id}"
    assert (act, salt) in {(edge["source"], edge["target"]) for edge in drawn["edges"]}


def test_what_the_dialog_needs_is_told_to_who_may(bench: Bench, reaction: dict[str, Any]) -> None:
    path = f"/api/v1/resources/{node(bench, 'jar')}/reaction"
    told = read(signed_in(bench.people["chemist"]), path)
    assert told["is_allowed"]
    assert {(lot["unit"], lot["amount"]) for lot in told["lots"]} == {
        ("nl", 1_000_000),
        ("ug", 50_000),
    }
    assert "Salt" in {one["name"] for one in told["materials"]}
    guest = read(signed_in(bench.people["observer"]), path)
    assert (guest["is_allowed"], guest["materials"]) == (False, [])
    other = signed_in(a_user("chemist", on=bench.node("heater_1"), name="guest"))
    assert call(other, "GET", path).status_code == 404
    bench_path = f"/api/v1/resources/{node(bench, 'bench_1')}/reaction"
    assert call(signed_in(bench.people["chemist"]), "GET", bench_path).status_code == 404
