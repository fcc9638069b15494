"""The station for organic synthesis as `make run` starts it: the synthesis, its report, its NMR."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.domain.workflows.station import in_a_chain
from tests.system.stack import Stack, is_over, running

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(0),
    pytest.mark.skipif(
        "LABWEB_SOAK" not in os.environ, reason="700 actions take half an hour: make soak"
    ),
]

LAB = Path(__file__).parents[2] / "fixtures/labs/organic_synthesis/lab.json"
ESTER_MG_UL = 1.09


@pytest.fixture(scope="module", params=["each valve at its vessels", "valves in a chain"])
def station(request: pytest.FixtureRequest) -> Iterator[Stack]:
    """Start the station; in a chain, liquid is handed on from syringe to syringe."""
    folder = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))
    lab = LAB
    if request.param == "valves in a chain":
        shutil.copytree(LAB.parent, folder / "station")
        lab = folder / "station/lab.json"
        lab.write_text(json.dumps(in_a_chain()), "utf-8")
    try:
        with running(folder / "lab", lab=lab, speed=200) as stack:
            stack.wait_until_online()
            yield stack
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="module")
def run(station: Stack) -> dict[str, Any]:
    """Run the whole recipe once."""
    begun = station.client().start("Benzhydryl acetate")
    return station.client().wait_for_run(begun["id"], is_over, 1500)


def really_ul(station: Stack, vessel: str) -> dict[str, float]:
    with station.instruments() as control:
        held = control.get("world").json()["vessels"][vessel]["contents"]
    return {name: amount / 1000 for name, amount in held.items()}


def report(station: Stack, run: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = station.client().get(f"runs/{run['id']}/report")
    return found


def test_the_recipe_runs_to_its_end(station: Stack, run: dict[str, Any]) -> None:
    undone = [(j["sentence"], j["message"]) for j in run["jobs"] if j["state"] != "complete"]
    assert run["state"] == "complete", undone
    product_g = really_ul(station, "rotavap_flask")["benzhydryl_acetate"] * ESTER_MG_UL / 1000
    assert 5.0 < product_g < 5.6


def test_the_report_balances_the_masses(station: Stack, run: dict[str, Any]) -> None:
    found = report(station, run)
    assert found["unknown"] == []
    assert found["taken_ug"] > 300_000_000
    assert abs(found["gap_ug"]) < 1000
    assert {row["account"] for row in found["brought"]} == {"vessel"}


def test_the_yield_is_reckoned_from_what_was_weighed(station: Stack, run: dict[str, Any]) -> None:
    client, flask = station.client(), station.keys()["rotavap_flask"]
    (before,) = report(station, run)["yields"]
    assert before["ratio"] == pytest.approx(1.0, abs=0.01)
    weighed_ul = really_ul(station, "rotavap_flask")["benzhydryl_acetate"]
    taken_stock = {
        "op": "correct",
        "resource_id": flask,
        "account": "LOSS",
        "reason": "weighed, purity by NMR",
        "measured_nl": {before["product_id"]: round(weighed_ul * 1000)},
    }
    client.call("POST", "operations", {"operation": taken_stock, "note": ""})
    (after,) = report(station, run)["yields"]
    assert 0.88 < after["ratio"] < 0.98
    assert after["isolated_ug"] == pytest.approx(weighed_ul * ESTER_MG_UL * 1000, rel=0.001)


def test_a_spectrum_of_the_product_is_in_the_report(station: Stack, run: dict[str, Any]) -> None:
    client, flask = station.client(), station.keys()["rotavap_flask"]
    with station.instruments() as control:
        text = control.get("vessels/rotavap_flask/spectrum").json()["jcamp_dx"]
    answer = client.http.post(
        "files",
        files={"file": ("product.jdx", text.encode(), "chemical/x-jcamp-dx")},
        data={"format": "jcamp", "resource": flask},
        headers=client.headers(),
    )
    assert answer.status_code == 202, answer.text
    deadline = time.monotonic() + 60
    while not (readings := report(station, run)["readings"]):
        assert time.monotonic() < deadline
        time.sleep(0.5)
    assert readings[0]["quantity"] == "nmr spectrum"
    points = client.get(f"readings/{readings[0]['id']}/points?points=2000")["points"]

    def peak(low: float, high: float) -> float:
        return float(max(height for shift, height in points if low < shift < high))

    # The acetyl group and the proton beside the oxygen, three to one.
    assert peak(2.1, 2.2) > 2 * peak(6.8, 6.95)
    assert peak(6.8, 6.95) > 10 * peak(3.9, 4.1)
