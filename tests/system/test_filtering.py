"""A solid is washed on a filter and dried, by the instruments of a whole lab."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from labweb.domain.recipes.xdl.lab_choices.declarations_file import Declared
from tests.domain.recipes.test_solid_recipes import ADD, DRY, FILTER, KEYS, WASH, document_of
from tests.domain.workflows.solids import filter_raw
from tests.system.stack import Stack, is_over, running

pytestmark = [pytest.mark.slow, pytest.mark.timeout(0)]


@pytest.fixture(scope="module")
def station() -> Iterator[Stack]:
    folder = Path(tempfile.mkdtemp(prefix="lw-", dir="/tmp"))
    try:
        (folder / "lab.json").write_bytes(filter_raw())
        (folder / "workflows").mkdir()
        stated = Declared(keys=KEYS, waste="waste", stays=[["salt"], ["salt"]])
        document = document_of(ADD + FILTER + WASH + DRY, stated)
        (folder / "workflows/solids.json").write_text(json.dumps(document), "utf-8")
        with running(folder / "data", lab=folder / "lab.json", speed=100) as stack:
            stack.wait_until_online()
            yield stack
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def test_a_recipe_that_filters_washes_and_dries_runs_to_its_end(station: Stack) -> None:
    client = station.client()
    run = client.wait_for_run(client.start("Solids")["id"], is_over, 600)
    undone = [(j["sentence"], j["message"]) for j in run["jobs"] if j["state"] != "complete"]
    assert run["state"] == "complete", undone
    with station.instruments() as control:
        vessels = control.get("world").json()["vessels"]
    held_ul = {key: sum(one["contents"].values()) / 1000 for key, one in vessels.items()}
    assert held_ul["separator"] < 1
    assert held_ul["waste"] == pytest.approx(20_000, rel=0.01), vessels
