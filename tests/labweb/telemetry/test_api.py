"""Curves and exports: as finely as asked, never more than is bearable, and only to who may see."""

from __future__ import annotations

import csv
import io
import time
from uuid import UUID

import pyarrow.parquet as pq  # type: ignore[import-untyped]
import pytest
from django.test import Client
from pytest_django import DjangoAssertNumQueries

from labweb.domain.messages.telemetry import TelemetryGap
from labweb.domain.telemetry_resolution import LEVELS_S
from labweb.telemetry import services
from labweb.telemetry.services import roll_ups, telemetry_export
from tests.builders import Bench
from tests.labweb.web import call, code_of, read, signed_in

BEGIN = float(int(time.time() - 7200) // 3600 * 3600)
COUNT = 1200


@pytest.fixture
def client(bench: Bench) -> Client:
    return signed_in(bench.people["observer"])


@pytest.fixture
def path(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> str:
    """A heater with twenty minutes of two statuses, and a gap."""
    monkeypatch.setattr(roll_ups, "_WAIT_S", dict.fromkeys(LEVELS_S, 0.0))
    device = bench.device("heater_1")
    told: list[tuple[str, str, float, object]] = [
        (str(device.id), "temperature_c", BEGIN + place, 20.0 + place % 60)
        for place in range(COUNT)
    ]
    told.append((str(device.id), "comment", BEGIN + 0.25, 'a, "b"\n=c'))
    gap = TelemetryGap(
        device_ids=[str(device.id)],
        since_s=BEGIN + 100,
        until_s=BEGIN + 101,
        lost_count=3,
        reason="overflow",
    )
    services.take_in({device.id}, told, [gap])
    while services.roll_up(budget_s=10.0):
        continue
    return f"/api/v1/devices/{device.id}/telemetry"


def within(span_s: float, **more: object) -> str:
    fields = {"since_s": BEGIN, "until_s": BEGIN + span_s} | more
    return "?" + "&".join(f"{name}={value}" for name, value in fields.items())


def test_a_curve_tells_its_level_its_words_and_its_gaps(client: Client, path: str) -> None:
    found = read(client, f"{path}/curves{within(1200, points=20, status='temperature_c')}")
    (curve,) = found["curves"]
    assert (curve["level_s"], curve["step_s"], curve["unit"]) == (60, 60, "°C")
    assert curve["points"][0] == [BEGIN, 49.5, 20.0, 79.0, 60]
    assert len(curve["points"]) == 20
    gap = {"since": BEGIN + 100, "until": BEGIN + 101, "lost_count": 3, "reason": "overflow"}
    assert found["gaps"] == [gap]


def test_a_short_range_is_answered_with_the_samples(client: Client, path: str) -> None:
    curves = read(client, f"{path}/curves{within(60)}")["curves"]
    assert [curve["status"] for curve in curves] == ["comment", "temperature_c"]
    assert curves[1]["level_s"] == 0
    assert curves[1]["points"][:2] == [[BEGIN, 20.0], [BEGIN + 1, 21.0]]


@pytest.mark.parametrize("until", [1e10, 9.9e10])
def test_a_huge_range_is_answered_with_few_points(client: Client, path: str, until: float) -> None:
    asked = f"{path}/curves?since_s=0&until_s={until}&points=2000&status=temperature_c"
    (curve,) = read(client, asked)["curves"]
    assert curve["level_s"] == 3600
    assert len(curve["points"]) == 1
    assert curve["points"][0][4] == COUNT


@pytest.mark.parametrize(
    ("asked", "code"),
    [
        ("since_s=5&until_s=5", "http.query"),
        ("since_s=nan", "http.query"),
        ("since_s=-1", "http.query"),
        ("until_s=1e12", "http.query"),
        ("points=9", "http.query"),
        ("points=2001", "http.query"),
        ("points=many", "http.query"),
        ("status=nobody", "telemetry.unknown_status"),
        ("status=%00", "http.query"),
    ],
)
def test_a_question_that_is_none_is_refused(
    client: Client, path: str, asked: str, code: str
) -> None:
    answer = call(client, "GET", f"{path}/curves?{asked}")
    assert (answer.status_code, code_of(answer)) == (422, code)


@pytest.mark.parametrize("asked", ["form=xls", "level=2s", "since_s=9&until_s=8", "status=nobody"])
def test_an_export_that_is_none_is_refused(client: Client, path: str, asked: str) -> None:
    assert call(client, "GET", f"{path}/export?{asked}").status_code == 422


def test_who_is_not_signed_in_gets_nothing(bench: Bench, path: str) -> None:
    stranger = signed_in(None)
    for name in ("curves", "export"):
        assert call(stranger, "GET", f"{path}/{name}").status_code in {401, 403}


def test_an_answer_costs_as_many_queries_for_ten_points_as_for_many(
    client: Client, path: str, django_assert_max_num_queries: DjangoAssertNumQueries
) -> None:
    for span_s in (10, 1200, 30 * 86400):
        with django_assert_max_num_queries(12):
            read(client, f"{path}/curves{within(span_s)}")


def test_samples_are_exported_whole_as_csv(client: Client, path: str) -> None:
    answer = call(client, "GET", f"{path}/export{within(3600)}")
    assert answer["Content-Disposition"].startswith('attachment; filename="heater_1-raw-')
    rows = list(csv.DictReader(io.StringIO(answer.content.decode(), newline="")))
    assert len(rows) == COUNT + 1
    assert rows[0]["other_json"] == '"a, \\"b\\"\\n=c"'
    first = rows[1]
    assert (first["device"], first["status"], first["unit"]) == ("heater_1", "temperature_c", "°C")
    assert float(first["number"]) == 20.0
    assert first["at"].endswith(":00:00.000000Z")


def test_parquet_holds_what_csv_holds(client: Client, path: str) -> None:
    for level, count in (("raw", COUNT + 1), ("1s", COUNT), ("1min", 20), ("1h", 1)):
        asked = f"{path}/export{within(3600, level=level)}"
        rows = list(csv.DictReader(io.StringIO(call(client, "GET", asked).content.decode())))
        raw = call(client, "GET", f"{asked}&form=parquet").content
        table = pq.read_table(io.BytesIO(raw)).to_pylist()
        assert len(rows) == len(table) == count
        assert table[-1]["at"].timestamp() >= BEGIN
        assert [row["status"] for row in rows] == [row["status"] for row in table]
        if level == "raw":
            assert [row["number"] for row in table] == [
                float(row["number"]) if row["number"] else None for row in rows
            ]
        else:
            assert sum(row["count"] for row in table) == COUNT
            assert table[0]["width_s"] == {"1s": 1, "1min": 60, "1h": 3600}[level]


def test_an_export_of_nothing_has_its_columns(client: Client, path: str) -> None:
    asked = f"{path}/export?since_s=1&until_s=2"
    assert call(client, "GET", asked).content.decode().startswith("at,device,status,unit,number")
    raw = call(client, "GET", f"{asked}&form=parquet").content
    table = pq.read_table(io.BytesIO(raw))
    assert (table.num_rows, table.column_names[0]) == (0, "at")


def test_an_export_beyond_its_bound_is_refused_whole(
    client: Client, path: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(telemetry_export, "MOST_ROWS", COUNT)
    answer = call(client, "GET", f"{path}/export{within(3600)}")
    assert (answer.status_code, code_of(answer)) == (422, "telemetry.too_large")
    asked = f"{path}/export{within(3600, status='temperature_c')}"
    assert call(client, "GET", asked).status_code == 200


def test_an_unknown_device_has_no_curves(client: Client) -> None:
    asked = f"/api/v1/devices/{UUID(int=5)}/telemetry/curves"
    assert code_of(call(client, "GET", asked)) == "device.not_found"
