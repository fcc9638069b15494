"""The lab, its deliveries and its contents as downloads."""

from __future__ import annotations

import csv
import io
import json
from typing import Any

import pytest

from labweb.accounts.selectors import User
from labweb.domain.crutd.delivery_table import (
    Delivery,
    DeliveryShare,
    parse_deliveries,
    render_deliveries,
)
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.resources.contents_by_lot import Phase
from labweb.resources.models import Resource
from tests.builders import Bench, a_user
from tests.labweb.crutd.hand import nl
from tests.labweb.web import call, signed_in

pytestmark = pytest.mark.django_db


def fetched(user: User, path: str) -> Any:  # noqa: ANN401 - Django's answer
    return call(signed_in(user), "GET", path)


def test_the_lab_comes_back_as_the_file_that_opens_it(bench: Bench) -> None:
    answer = fetched(bench.people["chemist"], "/api/v1/lab/export")
    assert answer.status_code == 200
    assert "attachment" in answer["Content-Disposition"]
    lab = read_lab(answer.content)
    assert {one.key for one in lab.resources} == set(
        Resource.objects.filter(lab=bench.lab).values_list("key", flat=True)
    )


def test_the_lab_goes_to_uni_lab_os(bench: Bench) -> None:
    answer = fetched(bench.people["chemist"], "/api/v1/lab/export?form=uni-lab-os")
    assert {"nodes", "links"} <= set(json.loads(answer.content))


def test_what_was_received_reads_as_deliveries(bench: Bench) -> None:
    answer = fetched(bench.people["chemist"], "/api/v1/lots/export")
    assert answer["Content-Type"].startswith("text/csv")
    assert parse_deliveries(answer.content)


def test_what_a_supplier_is_called_is_no_formula_and_reads_as_it_was() -> None:
    told = Delivery(
        lot="+w7", material="water", phase=Phase.LIQUID,
        shares=(DeliveryShare(2, "flask_1", 5_000),),
        supplier='=HYPERLINK("x")', number="'t Hart", purity="-1",
    )  # fmt: skip
    text = render_deliveries([told])
    (row,) = csv.DictReader(io.StringIO(text))
    assert not any(cell.startswith(("=", "+", "-", "@")) for cell in row.values())
    assert parse_deliveries(text.encode()) == (told,)


def test_each_row_of_the_contents_is_what_the_ledger_holds(bench: Bench) -> None:
    answer = fetched(bench.people["chemist"], "/api/v1/resources/contents")
    table = list(csv.DictReader(io.StringIO(answer.content.decode())))
    assert table
    told: dict[str, int] = {}
    for row in table:
        told[row["key"]] = told.get(row["key"], 0) + int(row["amount_nl"])
    assert told == {key: nl(bench, key) for key in told}
    assert "water" in told


def test_a_name_is_no_formula(bench: Bench) -> None:
    first = fetched(bench.people["chemist"], "/api/v1/resources/contents").content.decode()
    key = next(csv.DictReader(io.StringIO(first)))["key"]
    Resource.objects.filter(key=key).update(name="=HYPERLINK(1)")
    text = fetched(bench.people["chemist"], "/api/v1/resources/contents").content.decode()
    assert "'=HYPERLINK(1)" in text
    assert ",=HYPERLINK" not in text


def test_who_sees_a_part_gets_that_part_of_the_contents_alone(bench: Bench) -> None:
    stranger = a_user("chemist", on=bench.node("flask_1"), name="visitor")
    text = fetched(stranger, "/api/v1/resources/contents").content.decode()
    assert {row["key"] for row in csv.DictReader(io.StringIO(text))} <= {"flask_1"}
    for path in ("/api/v1/lab/export", "/api/v1/lots/export"):
        assert fetched(stranger, path).status_code == 403


def test_an_unknown_form_and_a_time_to_come_are_refused(bench: Bench) -> None:
    chemist = bench.people["chemist"]
    assert fetched(chemist, "/api/v1/lab/export?form=xml").status_code == 422
    late = fetched(chemist, "/api/v1/resources/contents?at=2999-01-01T00:00:00Z")
    assert late.json()["code"] == "time.future"
