"""Kept files and readings in the provenance of samples, lots, runs and devices.

```text
water ──▶ reactor_1 ──▶ flask_1
              └── spectrum.jdx ──▶ readings
```
"""

from __future__ import annotations

import io
import json
from datetime import timedelta
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest
from django.core.management import CommandError, call_command
from django.db import connection
from django.test.utils import CaptureQueriesContext
from prov.model import ProvDocument
from pytest_django import Settings

from labweb.common.clock import now
from labweb.domain.crutd.provenance.prov_check import check_prov
from labweb.domain.crutd.provenance.prov_json_read import read_prov
from labweb.records.selectors import provenance
from labweb.resources.models import Lot
from labweb.runs.models import Run
from labweb.telemetry import services as telemetry_services
from labweb.telemetry.models import File, Reading
from tests.builders import HEAT, Bench, a_user
from tests.labweb.instrument_files import SPECTRUM, TRACE
from tests.labweb.records.test_provenance import API, carry, done, names, pour
from tests.labweb.records.test_ro_crate import PROFILES, issues, keep_context, packed
from tests.labweb.web import call, code_of, read, signed_in


@pytest.fixture(autouse=True)
def _store(settings: Settings, tmp_path: Path) -> None:
    settings.DATA_DIR = tmp_path / "data"


def keep(bench: Bench, raw: str = TRACE, *, kind: str = "csv", **links: Any) -> File:  # noqa: ANN401
    upload = telemetry_services.Upload(
        stream=io.BytesIO(raw.encode()), name=f"trace.{kind}", media_type="", format=kind, **links
    )
    return telemetry_services.keep_file(upload, lab=bench.lab, actor=bench.people["chemist"])


def of_job(bench: Bench, run: Run) -> File:
    job = run.jobs.order_by("-index")[0]
    return keep(bench, resource=bench.node("reactor_1"), device=job.device, job_id=job.pk)


def test_a_reading_leads_back_to_sample_lot_job_device_and_file(bench: Bench) -> None:
    run = done(bench)[0]
    file = of_job(bench, run)
    reading = Reading.objects.filter(file=file)[0]
    found = provenance.of_reading(reading, direction="up", depth=10)
    assert found.graph.root == f"reading/{reading.pk}"
    assert names(found, "reading") == {"absorbance"}
    assert names(found, "lot") == {"Water W-0001"}
    assert names(found, "run") == {"Run #1"}
    assert "Chemist Person" in names(found, "user")
    assert found.graph.nodes[f"file/{file.pk}"].facts["sha256"] == file.sha256
    bonds = {(r.bond.value, r.later, r.earlier) for r in found.graph.relations}
    assert ("wasDerivedFrom", f"reading/{reading.pk}", f"file/{file.pk}") in bonds
    assert ("wasInformedBy", f"measurement/{file.pk}", f"job/{file.job_id}") in bonds


def test_what_came_into_the_vessel_after_the_measurement_did_not_lead_to_it(bench: Bench) -> None:
    pour(bench, "water", "reactor_1", 5_000_000)
    file = keep(bench, resource=bench.node("reactor_1"))
    pour(bench, "acid", "reactor_1", 1_000)
    found = provenance.of_file(file, direction="up", depth=10)
    assert names(found, "lot") == {"Water W-0001"}
    state = max(
        node.facts["event_seq"] for node in found.graph.nodes.values() if node.type == "transaction"
    )
    reactor = bench.node("reactor_1").pk
    used = {r.earlier for r in found.graph.relations if r.later == f"measurement/{file.pk}"}
    assert f"state/{reactor}/{state}" in used


def test_a_sample_touched_its_readings_and_so_did_its_lot(bench: Bench) -> None:
    pour(bench, "water", "reactor_1", 5_000_000)
    keep(bench, resource=bench.node("reactor_1"))
    keep(bench, SPECTRUM, kind="jcamp", resource=bench.node("flask_2"))
    touched = provenance.of_resource(bench.node("water"), direction="down", depth=10)
    assert names(touched, "reading") == {"absorbance", "temperature"}
    of_lot = provenance.of_lot(Lot.objects.get(key="water_lot"), direction="down", depth=10)
    assert names(of_lot, "file") == {"trace.csv"}
    led = provenance.of_resource(bench.node("reactor_1"), direction="up", depth=10)
    assert names(led, "file") == {"trace.csv"}


def test_what_was_measured_when_the_matter_had_gone_is_none_of_it(bench: Bench) -> None:
    """The spectrum tells its own moment, months before the water came in."""
    pour(bench, "water", "reactor_1", 5_000_000)
    keep(bench, SPECTRUM, kind="jcamp", resource=bench.node("reactor_1"))
    found = provenance.of_lot(Lot.objects.get(key="water_lot"), direction="down", depth=10)
    assert names(found, "file") == set()
    own = provenance.of_resource(bench.node("reactor_1"), direction="up", depth=10)
    (told,) = [n for n in own.graph.nodes.values() if n.type == "measurement"]
    assert (told.facts["moment_by"], told.ended_at) == ("file", "2026-03-01T08:30:00Z")


def test_conditions_name_the_files_that_came_from_the_device_meanwhile(bench: Bench) -> None:
    heater, reactor = bench.device("heater_1"), bench.node("reactor_1")
    file = keep(bench, device=heater)
    carry(bench, "reactor_1", "bench_1")
    keep(bench, SPECTRUM, kind="jcamp", device=heater)
    path = f"{API}/resources/{reactor.pk}/conditions?device={heater.pk}"
    path += f"&since_s={(now() - timedelta(minutes=5)).timestamp()}"
    stays = read(signed_in(bench.people["observer"]), path)["stays"]
    told = [entry for stay in stays for entry in stay["files"]]
    assert [(entry["file_id"], entry["moment_by"]) for entry in told] == [(str(file.pk), "kept")]
    assert told[0]["sha256"] == file.sha256


def test_a_guest_is_not_told_of_files_about_what_is_outside(bench: Bench) -> None:
    pour(bench, "water", "reactor_1", 5_000_000)
    pour(bench, "reactor_1", "flask_1", 1_000_000)
    file = keep(bench, resource=bench.node("reactor_1"))
    guest = signed_in(a_user("observer", on=bench.node("flask_1"), name="guest"))
    flask = bench.node("flask_1").pk
    answer = call(guest, "GET", f"{API}/resources/{flask}/provenance?direction=up")
    assert str(file.pk) in answer.content.decode()
    assert file.sha256 not in answer.content.decode()
    assert "trace.csv" not in answer.content.decode()
    for path in (f"files/{file.pk}", f"readings/{Reading.objects.all()[0].pk}", f"files/{uuid4()}"):
        answer = call(guest, "GET", f"{API}/{path}/provenance")
        assert answer.status_code == 404
        assert code_of(answer) in {"file.not_found", "reading.not_found"}


def test_the_prov_document_of_a_file_comes_back_equal_and_is_consistent(bench: Bench) -> None:
    file = of_job(bench, done(bench)[0])
    client = signed_in(bench.people["observer"])
    told = read(client, f"{API}/files/{file.pk}/provenance?form=prov")
    raw = json.dumps(told).encode()
    assert check_prov(read_prov(raw)) == []
    document = ProvDocument.deserialize(content=raw.decode(), format="json")
    again = ProvDocument.deserialize(content=document.serialize(format="json"), format="json")
    assert again == document
    plain = read(client, f"{API}/readings/{Reading.objects.all()[0].pk}/provenance")
    assert plain["root"].startswith("reading/")


def test_more_files_cost_no_more_queries(bench: Bench) -> None:
    pour(bench, "water", "reactor_1", 5_000_000)
    counts = []
    for number in range(3):
        keep(bench, f"# no {number}\n{TRACE}", resource=bench.node("reactor_1"))
        with CaptureQueriesContext(connection) as queries:
            provenance.of_resource(bench.node("reactor_1"), direction="up", depth=10)
        counts.append(len(queries))
    assert len(set(counts)) == 1


@pytest.mark.filterwarnings("ignore:ConjunctiveGraph is deprecated:DeprecationWarning")
def test_the_crate_says_which_file_is_of_what(bench: Bench, tmp_path: Path) -> None:
    pour(bench, "water", "reactor_1", 5_000_000)
    run = done(bench, HEAT)[0]
    file = of_job(bench, run)
    archive = packed(bench, run)
    rows = json.loads(archive.read("ro-crate-metadata.json"))["@graph"]
    told = {entity["@id"]: entity for entity in rows}
    raw, series = f"files/{file.pk}.csv", f"files/{file.made_files.get().pk}.parquet"
    reactor = bench.node("reactor_1")
    assert told[raw]["about"] == {"@id": f"#resource-{reactor.pk}"}
    assert told[f"#resource-{reactor.pk}"]["name"] == reactor.name
    assert told[raw]["mentions"] == {"@id": f"#device-{file.device_id}"}
    assert told[series]["isBasedOn"] == {"@id": raw}
    document = json.loads(archive.read("provenance.json"))
    entity = document["entity"][f"lab:file/{file.pk}"]
    assert (entity["prov:label"], entity["labweb:sha256"]) == (raw, file.sha256)
    archive.extractall(tmp_path / "crate")
    keep_context(tmp_path / "cache")
    assert issues(tmp_path, PROFILES[0]) == []


def test_the_command_takes_files_and_readings(bench: Bench) -> None:
    pour(bench, "water", "reactor_1", 5_000_000)
    file = keep(bench, resource=bench.node("reactor_1"))
    told = []
    for subject in (str(file.pk), f"file:{file.pk}", file.sha256):
        out = io.StringIO()
        call_command("provenance", subject, stdout=out)
        told.append(out.getvalue())
    assert len(set(told)) == 1
    assert "Water W-0001" in told[0]
    out = io.StringIO()
    call_command("provenance", f"reading:{Reading.objects.all()[0].pk}", stdout=out)
    assert "absorbance" in out.getvalue()
    keep(bench, resource=bench.node("flask_1"))
    with pytest.raises(CommandError, match="several subjects"):
        call_command("provenance", file.sha256, stdout=io.StringIO())
