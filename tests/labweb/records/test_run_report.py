"""The report of a run: masses by account, yields by product, all of it reckoned from entries."""

from __future__ import annotations

import pytest

from labweb.resources.models import Lot, Material
from tests.builders import Bench, a_started_run, an_edge
from tests.labweb.records.test_provenance import API
from tests.labweb.runs.test_reaction_step import jar, started
from tests.labweb.web import read, signed_in

__all__ = ["jar"]


def test_masses_that_react_are_taken_and_what_comes_of_them_is_brought(jar: Bench) -> None:
    run = started(jar)
    an_edge(jar).work_off(run)
    found = read(signed_in(jar.people["observer"]), f"{API}/runs/{run.id}/report")
    lots = {row.key: str(row) for row in Lot.objects.all()}
    (vessel,) = found["taken"]
    assert (vessel["name"], vessel["resource_id"]) == ("Jar", str(jar.node("jar").pk))
    assert {row["lot"]: row["mass_ug"] for row in vessel["lots"]} == {
        lots["acid-1"]: -48_000,
        lots["base-1"]: -48_000,
        lots["salt-1"]: 90_000,
    }
    assert found["taken_ug"] == found["brought_ug"] == 6_000
    assert (found["gap_ug"], found["unknown"], found["yields"]) == (0, [], [])


@pytest.mark.parametrize(("mmol_l", "ratio"), [(0.0, None), (1000.0, 0.9)])
def test_a_yield_is_on_the_lot_that_the_step_names(
    jar: Bench, mmol_l: float, ratio: float | None
) -> None:
    # One gram a millilitre and one mole a litre: a millimole weighs a gram.
    Material.objects.filter(key="acid").update(density_mg_ul=1.0, concentration_mmol_l=1000.0)
    if mmol_l:
        Material.objects.filter(key="salt").update(density_mg_ul=1.0, concentration_mmol_l=mmol_l)
    run = started(
        jar,
        basis="base-1",
        consumed={"acid-1": "2 uL", "base-1": "50 mg"},
        mass="45 mg",
        residue="7 mg",
    )
    an_edge(jar).work_off(run)
    (row,) = read(signed_in(jar.people["observer"]), f"{API}/runs/{run.id}/report")["yields"]
    assert row["ratio"] == (None if ratio is None else pytest.approx(ratio))
    assert row["material"] == "Salt"
    assert row["basis"] == str(Lot.objects.get(key="base-1"))
    assert row["missing"] == ([row["product"]] if ratio is None else [])
    assert [place["name"] for place in row["stands_in"]] == ["Jar"]


def test_a_run_that_has_moved_nothing_has_an_empty_report(bench: Bench) -> None:
    run = a_started_run(bench)
    found = read(signed_in(bench.people["observer"]), f"{API}/runs/{run.id}/report")
    assert (found["taken"], found["brought"], found["yields"], found["readings"]) == (
        [],
        [],
        [],
        [],
    )


def test_a_stranger_finds_no_report(bench: Bench) -> None:
    run = a_started_run(bench)
    read(signed_in(None), f"{API}/runs/{run.id}/report", status=403)
