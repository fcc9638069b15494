"""A run with its instrument files, for notebooks and for whoever checks it."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from pathlib import Path
from typing import Any

import pytest
from django.core.management import CommandError, call_command
from pytest_django import Settings

from labweb.runs.models import Run
from labweb.telemetry import services as telemetry_services
from labweb.telemetry.selectors import path_of
from tests.builders import HEAT, Bench
from tests.labweb.instrument_files import TRACE
from tests.labweb.records.test_provenance import API
from tests.labweb.records.test_ro_crate import PROFILES, a_run, issues, keep_context, packed
from tests.labweb.web import call, code_of, signed_in


@pytest.fixture(autouse=True)
def _store(settings: Settings, tmp_path: Path) -> None:
    settings.DATA_DIR = tmp_path / "data"


def with_file(bench: Bench, run: Run) -> str:
    """Keep a trace that a job of the run gave; return its digest."""
    job = run.jobs.order_by("index")[0]
    upload = telemetry_services.Upload(
        stream=io.BytesIO(TRACE.encode()), name="trace.csv", media_type="", format="csv",
        resource=bench.node("reactor_1"), device=job.device, job_id=job.pk,
    )  # fmt: skip
    return telemetry_services.keep_file(upload, lab=bench.lab, actor=bench.people["chemist"]).sha256


def eln(bench: Bench, run: Run) -> zipfile.ZipFile:
    answer = call(signed_in(bench.people["observer"]), "GET", f"{API}/runs/{run.id}/eln")
    assert answer.status_code == 200, answer.content
    assert answer["Content-Type"] == "application/vnd.eln+zip"
    assert answer["Content-Disposition"] == f'attachment; filename="run-{run.number}.eln"'
    return zipfile.ZipFile(io.BytesIO(answer.content))


def graph(raw: bytes) -> dict[str, dict[str, Any]]:
    return {entity["@id"]: entity for entity in json.loads(raw)["@graph"]}


def test_a_notebook_gets_one_folder_with_one_experiment(bench: Bench) -> None:
    run = a_run(bench)
    digest = with_file(bench, run)
    archive = eln(bench, run)
    root = f"run-{run.number}"
    assert {name.split("/")[0] for name in archive.namelist()} == {root}
    told = graph(archive.read(f"{root}/ro-crate-metadata.json"))
    assert told["ro-crate-metadata.json"]["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    experiment = told[f"{root}/"]
    assert experiment["@type"] == "Dataset"
    assert experiment["name"] == f"Run #{run.number}: {HEAT}"
    assert told[experiment["author"]["@id"]]["name"] == "Chemist Person"
    assert "<li>" in experiment["text"]
    files = [entity for entity in told.values() if entity["@type"] == "File"]
    assert {part["@id"] for part in experiment["hasPart"]} == {file["@id"] for file in files}
    for file in files:
        raw = archive.read(f"{root}/{file['@id']}")
        assert file["sha256"] == hashlib.sha256(raw).hexdigest()
        assert file["contentSize"] == str(len(raw))
    assert digest in {file["sha256"] for file in files}


def test_what_a_page_says_of_a_run_is_no_markup_of_others(bench: Bench) -> None:
    run = a_run(bench)
    run.jobs.update(message="<script>alert(1)</script>")
    told = graph(eln(bench, run).read(f"run-{run.number}/ro-crate-metadata.json"))
    assert "<script>" not in told[f"run-{run.number}/"]["text"]
    assert "&lt;script&gt;" in told[f"run-{run.number}/"]["text"]


@pytest.mark.filterwarnings("ignore:ConjunctiveGraph is deprecated:DeprecationWarning")
def test_the_validator_accepts_the_folder_of_a_notebook(bench: Bench, tmp_path: Path) -> None:
    keep_context(tmp_path / "cache")
    run = a_run(bench)
    with_file(bench, run)
    eln(bench, run).extractall(tmp_path)
    (tmp_path / f"run-{run.number}").rename(tmp_path / "crate")
    assert issues(tmp_path, PROFILES[0]) == []


def test_a_crate_holds_the_instrument_files_of_the_run(bench: Bench) -> None:
    run = a_run(bench)
    digest = with_file(bench, run)
    crate = packed(bench, run)
    lines = crate.read("file_readings.jsonl").decode().splitlines()
    readings = {reading["name"]: reading for reading in map(json.loads, lines)}
    assert set(readings) == {"absorbance", "temperature"}
    raw = crate.read(readings["absorbance"]["file"])
    assert hashlib.sha256(raw).hexdigest() == digest == readings["absorbance"]["file_sha256"]
    assert crate.read(readings["absorbance"]["series_file"])[:4] == b"PAR1"
    prov = crate.read("provenance.json").decode()
    assert digest in prov


def test_a_run_whose_file_is_damaged_is_not_packed(bench: Bench, tmp_path: Path) -> None:
    run = a_run(bench)
    path_of(with_file(bench, run)).unlink()
    for form in ("eln", "crate"):
        answer = call(signed_in(bench.people["observer"]), "GET", f"{API}/runs/{run.id}/{form}")
        assert (answer.status_code, code_of(answer)) == (409, "file.damaged")
    out = tmp_path / "run.eln"
    with pytest.raises(CommandError, match=r"file\.damaged"):
        call_command("export_run", str(run.id), out=out, format="eln")
    assert not out.exists()
