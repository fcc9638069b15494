"""What runs measured, each value with all that led to it.

```text
acid ──▶ flask_1 ──▶ reactor_1 ── trace.csv
```
"""

from __future__ import annotations

import io
from io import StringIO
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq  # type: ignore[import-untyped]
import pytest
from django.core.management import CommandError, call_command
from google.protobuf import json_format  # type: ignore[import-untyped]
from ord_schema import validations  # type: ignore[import-untyped]
from ord_schema.proto import dataset_pb2  # type: ignore[import-untyped]
from pytest_django import Settings

from labweb.records.services import dataset
from labweb.resources.models import Lot
from labweb.runs.models import Run
from labweb.telemetry import services as telemetry_services
from labweb.telemetry.models import Reading, Sample
from labweb.telemetry.selectors import path_of
from tests.builders import HEAT, MOVE_WATER, Bench
from tests.labweb.instrument_files import TRACE
from tests.labweb.records.test_provenance import done, pour


@pytest.fixture(autouse=True)
def _store(settings: Settings, tmp_path: Path) -> None:
    settings.DATA_DIR = tmp_path / "data"


def a_measured_run(bench: Bench, workflow: str = HEAT) -> Run:
    """Heat what came through the flask, and keep a trace of the reactor."""
    pour(bench, "water", "flask_1", 3_000_000)
    pour(bench, "flask_1", "reactor_1", 2_000_000)
    run = done(bench, workflow)[0]
    job = run.jobs.order_by("index")[0]
    upload = telemetry_services.Upload(
        stream=io.BytesIO(TRACE.encode()), name="trace.csv", media_type="", format="csv",
        resource=bench.node("reactor_1"), device=job.device, job_id=job.pk,
    )  # fmt: skip
    telemetry_services.keep_file(upload, lab=bench.lab, actor=bench.people["chemist"])
    return run


def exported(run: Run, out: Path, *words: str, **options: Any) -> list[dict[str, Any]]:  # noqa: ANN401
    call_command(
        "export_dataset", *words, runs=[str(run.pk)], out=out, stdout=StringIO(), **options
    )
    rows: list[dict[str, Any]] = pq.read_table(out / "values.parquet").to_pylist()
    return rows


def test_each_point_has_its_place_and_its_whole_lineage(bench: Bench, tmp_path: Path) -> None:
    run = a_measured_run(bench)
    reading = Reading.objects.get(name="absorbance")
    rows = [r for r in exported(run, tmp_path / "out") if r["reading_id"] == str(reading.pk)]
    assert [row["number"] for row in rows] == [0.10, 0.15, 0.21]
    assert [row["axes"][0]["number"] for row in rows] == [0.0, 1.0, 2.0]
    row = rows[0]
    assert (row["quantity"], row["unit"], row["source"]) == ("absorbance", "1", "file")
    assert row["file_sha256"] == reading.file.sha256
    assert (row["run_number"], row["workflow_digest"]) == (run.number, run.version.digest)
    assert row["device"] == run.jobs.order_by("index")[0].device.key
    assert len(row["driver_digest"]) == 64
    assert row["vessels"] == ["reactor_1"]
    assert [(lot["lot"], lot["amount"], lot["amount_unit"]) for lot in row["lots"]] == [
        ("water_lot", 2_000_000, "nL")
    ]
    assert row["came_through"] == ["flask_1", "water"]
    assert row["is_lineage_whole"]


def test_lots_are_those_of_then_and_not_of_today(bench: Bench, tmp_path: Path) -> None:
    run = a_measured_run(bench)
    pour(bench, "reactor_1", "flask_1", 1_500_000)
    pour(bench, "acid", "reactor_1", 1_000_000)
    rows = exported(run, tmp_path / "out")
    lots = {(lot["lot"], lot["amount"]) for row in rows for lot in row["lots"]}
    assert ("water_lot", 2_000_000) in lots
    assert not {lot for lot, _ in lots} & {"acid_lot"}
    assert all("acid" not in row["came_through"] for row in rows)


def test_conditions_are_the_last_samples_up_to_the_end_of_the_job(
    bench: Bench, tmp_path: Path
) -> None:
    run = a_measured_run(bench)
    job = run.jobs.order_by("index")[0]
    assert job.ended_at is not None
    assert run.started_at is not None
    end, heater = job.ended_at.timestamp(), bench.device("heater_1")
    begin = run.started_at.timestamp()
    for at, value in ((begin, 20.0), ((begin + end) / 2, 41.5), (end + 60, 99.0), (1.0, 7.0)):
        Sample.objects.create(device=heater, status="temperature_c", at=at, value=value)
    rows = exported(run, tmp_path / "out")
    (condition,) = next(row["conditions"] for row in rows if row["job_id"] == str(job.pk))
    assert (condition["device"], condition["status"]) == ("heater_1", "temperature_c")
    assert condition["number"] == 41.5
    assert condition["age_s"] == pytest.approx((end - begin) / 2, abs=1e-5)


def test_a_data_set_is_written_whole_or_not_at_all(bench: Bench, tmp_path: Path) -> None:
    run = a_measured_run(bench)
    out = tmp_path / "out"
    path_of(Reading.objects.get(name="absorbance").series_file.sha256).unlink()  # type: ignore[union-attr]
    with pytest.raises(CommandError, match=r"file\.damaged"):
        exported(run, out)
    assert [path.name for path in tmp_path.iterdir()] == ["data"]
    with pytest.raises(CommandError, match="no run #99"):
        call_command("export_dataset", runs=["#99"], out=out)
    out.mkdir()
    with pytest.raises(CommandError, match="there already"):
        call_command("export_dataset", runs=[str(run.pk)], out=out)


def test_more_values_than_a_table_holds_are_refused(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = a_measured_run(bench)
    monkeypatch.setattr(dataset, "MOST_ROWS", 3)
    with pytest.raises(CommandError, match=r"dataset\.too_large"):
        exported(run, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_run_becomes_a_reaction_that_the_validator_accepts(bench: Bench, tmp_path: Path) -> None:
    run = a_measured_run(bench, MOVE_WATER)
    out = tmp_path / "out"
    exported(run, out, ord=True, contact="lab@example.org")
    found = dataset_pb2.Dataset.FromString((out / "dataset.pb").read_bytes())
    assert not validations.validate_message(found, raise_on_error=False).errors
    text = (out / "dataset.json").read_text()
    assert json_format.Parse(text, dataset_pb2.Dataset()) == found
    (reaction,) = found.reactions
    (component,) = reaction.inputs["water_lot"].components
    assert component.amount.volume.value == 7_000_000
    assert component.source.lot == Lot.objects.get(key="water_lot").number
    assert reaction.setup.vessel.details == "reactor reactor_1"
    assert reaction.provenance.experimenter.name == "Chemist Person"
    assert len(reaction.outcomes[0].analyses) == 2


def test_a_run_that_filled_nothing_is_no_reaction(bench: Bench, tmp_path: Path) -> None:
    run = a_measured_run(bench)
    with pytest.raises(CommandError, match=r"dataset\.no_reaction"):
        exported(run, tmp_path / "out", ord=True, contact="lab@example.org")
    assert not (tmp_path / "out").exists()


def test_what_the_validator_refuses_is_not_written(bench: Bench, tmp_path: Path) -> None:
    run = a_measured_run(bench, MOVE_WATER)
    with pytest.raises(CommandError, match=r"dataset\.ord_invalid.*email"):
        exported(run, tmp_path / "out", ord=True, contact="nobody")
    with pytest.raises(CommandError, match="--contact"):
        exported(run, tmp_path / "out", ord=True)
    assert not (tmp_path / "out").exists()
