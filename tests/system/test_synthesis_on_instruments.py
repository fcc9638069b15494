"""The two-step synthesis from its recipe to a flask of product, and what there is to say of it."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from labweb.common.instruments import jcamp_dx
from labweb.domain.crutd.mass_balance import LotFacts, find_yields, mass_balance
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.workflows.compile_workflow import compile_workflow
from tests.domain.workflows.station import recipe_document, station, station_file, workflow
from tests.system.bench_run import BenchRun, bench_run

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]

ESTER_MG_UL, ESTER_G_MOL, ALDEHYDE_G_MOL = 1.09, 226.27, 106.12


@pytest.fixture(scope="module")
def done() -> Iterator[BenchRun]:
    """Carry the recipe out once, a thousand times as fast as real time."""
    folder = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))
    try:
        view = station()
        plan = compile_workflow(workflow(recipe_document()), view)
        with bench_run(station_file(), view, folder, speed=1000) as run:
            run.carry_out(plan)
            yield run
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def facts(run: BenchRun) -> dict[LotId, LotFacts]:
    """Return what the lab states of its lots, and of those that the reactions made."""
    materials = run.lab.materials_by_id
    known = {LotId(str(lot.id)): (lot.key, lot.material_id) for lot in run.lab.lots}
    for reaction in run.reactions:
        for product in reaction.products:
            known[LotId(str(product.lot_id))] = (product.key, product.material_id)
    return {
        lot: LotFacts(
            key=key,
            density_mg_ul=materials[material].density_mg_ul,
            concentration_mmol_l=materials[material].concentration_mmol_l,
        )
        for lot, (key, material) in known.items()
    }


def test_the_product_ends_in_the_evaporating_flask(done: BenchRun) -> None:
    really = done.really_ul("rotavap_flask")
    product_g = really["benzhydryl_acetate"] * ESTER_MG_UL / 1000
    assert 5.0 < product_g < 5.6, really
    assert product_g / (sum(really.values()) / 1000) > 0.9, really


def test_every_layer_went_where_the_recipe_sends_it(done: BenchRun) -> None:
    waste = done.really_ul("waste")
    assert waste["sodium_chloride"] > 0
    assert waste["triethylammonium_chloride"] > 0
    assert waste.get("benzhydryl_acetate", 0) < 50
    assert waste["diethyl_ether"] > 35_000
    assert waste["tetrahydrofuran"] > 50_000
    assert waste["dichloromethane"] > 70_000
    assert not any(done.states[done.ids[f"pump_{n}"]].contents for n in (1, 2, 3, 4))


def test_record_and_bench_agree_on_every_volume(done: BenchRun) -> None:
    for key in ("reactor", "separator", "crude", "rotavap_receiver", "waste"):
        assert sum(done.really_ul(key).values()) == pytest.approx(
            sum(done.recorded_ul(key).values()), abs=1500
        ), key


def test_what_was_taken_is_what_was_brought(done: BenchRun) -> None:
    balance = mass_balance(done.moves, facts(done))
    assert not balance.unknown
    assert balance.taken_ug > 300_000_000
    assert abs(balance.gap_ug) <= 2 * len(done.moves)


def test_the_yield_follows_from_the_record_once_the_flask_is_weighed(done: BenchRun) -> None:
    product = done.reactions[-1].products[0].lot_id
    lot = LotId(str(product))
    (before,) = find_yields(done.reactions, facts(done), {lot: (done_nl(done, lot), 0)})
    assert before.ratio == pytest.approx(1.0, abs=0.01)
    weighed_mg = done.really_ul("rotavap_flask")["benzhydryl_acetate"] * ESTER_MG_UL
    stock = round(weighed_mg / ESTER_MG_UL * 1000)
    (after,) = find_yields(done.reactions, facts(done), {lot: (stock, 0)})
    aldehyde_mmol = 2550 * 1.044 / ALDEHYDE_G_MOL
    assert after.ratio == pytest.approx(weighed_mg / ESTER_G_MOL / aldehyde_mmol, rel=0.002)
    assert after.ratio is not None
    assert 0.88 < after.ratio < 0.98


def done_nl(run: BenchRun, lot: LotId) -> int:
    return run.states[run.ids["rotavap_flask"]].contents[lot]


def test_the_spectrum_is_of_what_is_in_the_flask(done: BenchRun, tmp_path: Path) -> None:
    path = tmp_path / "product.jdx"
    path.write_text(done.bench.get("/vessels/rotavap_flask/spectrum")["jcamp_dx"])
    found = jcamp_dx.read(path)
    (reading,) = found.readings
    assert reading.quantity == "nmr spectrum"
    shifts, heights = (column.values for column in found.tables[0])
    points = list(zip(map(float, shifts), map(float, heights), strict=True))

    def area(low: float, high: float) -> float:
        return sum(height for shift, height in points if low < shift < high)

    # The acetyl group and the proton beside the oxygen, three to one.
    assert area(2.14, 2.18) / area(6.87, 6.91) == pytest.approx(3.0, rel=0.1)
    assert area(6.87, 6.91) > 20 * area(3.98, 4.02)
