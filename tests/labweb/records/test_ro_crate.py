"""A run in one file, that somebody elsewhere can understand and check."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from importlib import resources
from pathlib import Path
from typing import IO, Any

import pyarrow.parquet as pq  # type: ignore[import-untyped]
import pytest
import requests
from asgiref.sync import async_to_sync
from django.core.management import CommandError, call_command
from django.http import StreamingHttpResponse
from django.test import AsyncClient
from requests_cache import CachedSession
from rocrate.rocrate import ROCrate  # type: ignore[import-untyped]
from rocrate_validator.models import Severity  # type: ignore[import-untyped]
from rocrate_validator.services import validate  # type: ignore[import-untyped]
from urllib3 import HTTPResponse

from labweb.common.files import download
from labweb.crutd.models import Event
from labweb.crutd.services import event_hash
from labweb.domain.crutd.provenance.prov_check import check_prov
from labweb.domain.crutd.provenance.prov_json_read import read_prov
from labweb.records.api import ro_crate as crate_api
from labweb.records.services import ro_crate as crates
from labweb.runs.models import Run
from labweb.telemetry.models import Sample
from tests.builders import HEAT, Bench, a_started_run, a_user
from tests.labweb.records.test_provenance import API, done, pour
from tests.labweb.web import call, code_of, signed_in

FILES = {
    "workflow.json",
    "plan.json",
    "events.jsonl",
    "host_events.jsonl",
    "ledger.jsonl",
    "readings.jsonl",
    "approvals.json",
    "telemetry.parquet",
    "provenance.json",
}


def a_run(bench: Bench) -> Run:
    """Carry out a heating with what its device told meanwhile."""
    pour(bench, "water", "reactor_1", 5_000_000)
    run = done(bench, HEAT)[0]
    heater, pump = bench.device("heater_1"), bench.device("pump_1")
    assert run.started_at is not None
    assert run.ended_at is not None
    middle = (run.started_at.timestamp() + run.ended_at.timestamp()) / 2
    told = [
        (heater, "temperature_c", middle, 59.5),
        (heater, "is_heating", middle, True),
        (heater, "temperature_c", middle - 86400, 20.0),
        (pump, "position_ul", middle, 1.0),
    ]
    Sample.objects.bulk_create(
        Sample(device=device, status=status, at=at, value=value)
        for device, status, at, value in told
    )
    return run


def packed(bench: Bench, run: Run, person: str = "observer") -> zipfile.ZipFile:
    answer = call(signed_in(bench.people[person]), "GET", f"{API}/runs/{run.id}/crate")
    assert answer.status_code == 200, answer
    assert answer["Content-Type"] == "application/zip"
    assert answer["Content-Disposition"] == f'attachment; filename="run-{run.number}.crate.zip"'
    assert answer["Content-Length"] == str(len(answer.content))
    return zipfile.ZipFile(io.BytesIO(answer.content))


def lines(crate: zipfile.ZipFile, name: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in crate.read(name).decode().splitlines()]


def metadata(crate: zipfile.ZipFile) -> dict[str, dict[str, Any]]:
    graph = json.loads(crate.read("ro-crate-metadata.json"))["@graph"]
    return {entity["@id"]: entity for entity in graph}


def test_a_crate_holds_every_file_with_its_size_and_checksum(bench: Bench) -> None:
    crate = packed(bench, a_run(bench))
    assert set(crate.namelist()) == FILES | {"ro-crate-metadata.json"}
    told = metadata(crate)
    for name in FILES:
        raw = crate.read(name)
        assert told[name]["sha256"] == hashlib.sha256(raw).hexdigest()
        assert told[name]["contentSize"] == str(len(raw))
        assert told[name]["description"]


PROFILES = ("ro-crate-1.1", "process-run-crate-0.5", "workflow-run-crate-0.5")


def keep_context(cache: Path) -> None:
    """Put the context of RO-Crate 1.1 where the validator looks, so that it needs no network.

    It is the one that `rocrate` brings along, a successor of 1.1, with the older addresses of
    the words of Bioschemas.
    """
    packaged = (resources.files("rocrate") / "data/ro-crate.jsonld").read_bytes()
    context = packaged.replace(b"https://bioschemas.org/terms/", b"https://bioschemas.org/")
    address = "https://w3id.org/ro/crate/1.1/context"
    kind = {"Content-Type": "application/ld+json"}
    response = requests.Response()
    response.status_code, response.url = 200, address
    response.headers.update(kind)
    response.request = requests.Request("GET", address).prepare()
    response.raw = HTTPResponse(
        io.BytesIO(context), kind, 200, preload_content=False, request_url=address
    )
    with CachedSession(str(cache), backend="sqlite") as session:
        session.cache.save_response(response)


def issues(folder: Path, profile: str) -> list[str]:
    """Return what the validator has against a crate, by what is packaged alone."""
    settings = {
        "rocrate_uri": str(folder / "crate"),
        "profile_identifier": profile,
        "requirement_severity": Severity.REQUIRED,
        "cache_path": folder / "cache",
        "offline": True,
    }
    return [str(issue.message) for issue in validate(settings).get_issues()]


@pytest.mark.filterwarnings("ignore:ConjunctiveGraph is deprecated:DeprecationWarning")
def test_the_validator_accepts_a_crate_and_misses_what_is_gone(
    bench: Bench, tmp_path: Path
) -> None:
    keep_context(tmp_path / "cache")
    packed(bench, a_run(bench)).extractall(tmp_path / "crate")
    found = {profile: issues(tmp_path, profile) for profile in PROFILES}
    assert not any(found.values()), found
    (tmp_path / "crate" / "telemetry.parquet").unlink()
    assert any("telemetry.parquet" in issue for issue in issues(tmp_path, PROFILES[0]))


def test_a_crate_says_who_did_what_when_and_by_which_workflow(bench: Bench, tmp_path: Path) -> None:
    run = a_run(bench)
    packed(bench, run).extractall(tmp_path)
    crate = ROCrate(tmp_path)
    action = crate.get(f"#run-{run.id}")
    assert action["agent"]["name"] == "Chemist Person"
    assert action["instrument"] == crate.mainEntity
    assert crate.mainEntity["identifier"] == run.version.digest
    assert action["actionStatus"] == "http://schema.org/CompletedActionStatus"
    devices = {e["identifier"] for e in crate.get_by_type("IndividualProduct")}
    assert devices == {"heater_1"}


def test_telemetry_is_that_of_the_runs_devices_while_it_went_on(bench: Bench) -> None:
    crate = packed(bench, a_run(bench))
    table = pq.read_table(io.BytesIO(crate.read("telemetry.parquet"))).to_pylist()
    rows = {(r["device"], r["status"], r["number"], r["other_json"]) for r in table}
    assert rows == {
        ("heater_1", "temperature_c", 59.5, None),
        ("heater_1", "is_heating", None, "true"),
    }
    assert all(row["at"].tzinfo is not None for row in table)


def test_events_can_be_checked_by_their_hashes(bench: Bench) -> None:
    run = a_run(bench)
    events = lines(packed(bench, run), "events.jsonl")
    jobs = {str(job.pk) for job in run.jobs.all()}
    assert {event["body"]["job_id"] for event in events} == jobs
    assert [event["seq"] for event in events] == sorted(event["seq"] for event in events)
    for event in events:
        at = Event.objects.get(seq=event["seq"]).at.isoformat()
        assert event["hash"] == event_hash(
            event["prev_hash"], event["seq"], at, event["transaction_id"], event["body"]
        )


def test_a_crate_holds_plan_ledger_host_events_and_decisions(bench: Bench) -> None:
    run = done(bench)[0]
    crate = packed(bench, run)
    assert json.loads(crate.read("plan.json")) == {"digest": run.plan_digest, "plan": run.plan}
    assert json.loads(crate.read("workflow.json")) == run.version.document
    moved = lines(crate, "ledger.jsonl")
    assert [row["amount_nl"] for row in moved] == [5_000_000, 5_000_000]
    assert moved[0]["credit"] == moved[1]["debit"]
    kinds = {line["kind"] for line in lines(crate, "host_events.jsonl")}
    assert kinds >= {"accepted", "started", "actuated", "complete"}
    heated = packed(bench, done(bench, HEAT)[0])
    (decision,) = json.loads(heated.read("approvals.json"))
    assert decision["printed_name"] == "Approver Person"


def test_the_provenance_in_a_crate_is_valid_and_names_the_other_files(bench: Bench) -> None:
    crate = packed(bench, a_run(bench))
    raw = crate.read("provenance.json")
    assert check_prov(read_prov(raw)) == []
    told = metadata(crate)
    for name in FILES - {"provenance.json"}:
        assert f"lab:file/{told[name]['sha256']}" in json.loads(raw)["entity"]


def test_a_run_that_has_not_begun_has_a_crate_too(bench: Bench) -> None:
    crate = packed(bench, a_started_run(bench))
    assert lines(crate, "events.jsonl") == []
    assert pq.read_table(io.BytesIO(crate.read("telemetry.parquet"))).num_rows == 0


def test_a_run_with_too_many_samples_is_refused(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = a_run(bench)
    monkeypatch.setattr(crates, "MOST_SAMPLES", 1)
    answer = call(signed_in(bench.people["admin"]), "GET", f"{API}/runs/{run.id}/crate")
    assert (answer.status_code, code_of(answer)) == (409, "crate.too_large")


def test_a_crate_is_sent_in_blocks_and_vanishes_with_the_answer(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = done(bench)[0]
    monkeypatch.setattr(download, "_BLOCK", 1000)
    opened: list[IO[bytes]] = []
    pack = crates.pack_run

    def watched(*args: Any) -> IO[bytes]:  # noqa: ANN401 - as they come
        opened.append(pack(*args))
        return opened[-1]

    monkeypatch.setattr(crate_api, "pack_run", watched)

    async def blocks() -> list[bytes]:
        client = AsyncClient()
        await client.aforce_login(bench.people["observer"])
        answer = await client.get(f"{API}/runs/{run.id}/crate")
        assert isinstance(answer, StreamingHttpResponse)
        assert answer.is_async
        return [block async for block in answer]

    found = async_to_sync(blocks)()
    assert {len(block) for block in found[:-1]} == {1000}
    assert set(zipfile.ZipFile(io.BytesIO(b"".join(found))).namelist()) >= FILES
    assert [file.closed for file in opened] == [True]


def test_who_may_not_see_a_run_gets_no_crate(bench: Bench) -> None:
    run = a_run(bench)
    guest = a_user("chemist", on=bench.node("balance_1"), name="guest")
    answer = call(signed_in(guest), "GET", f"{API}/runs/{run.id}/crate")
    assert (answer.status_code, code_of(answer)) == (404, "run.not_found")


def test_the_command_writes_a_crate_whole_or_not_at_all(bench: Bench, tmp_path: Path) -> None:
    run = a_run(bench)
    for name in (str(run.id), str(run.number), f"#{run.number}"):
        out = tmp_path / "crate.zip"
        call_command("export_run", name, out=out, stdout=io.StringIO())
        assert set(zipfile.ZipFile(out).namelist()) >= FILES
        out.unlink()
    for name in ("99", "x", "01a1ff83-715d-74e5-825c-a26fcaed99db"):
        with pytest.raises(CommandError):
            call_command("export_run", name, out=tmp_path / "none.zip", stdout=io.StringIO())
    with pytest.raises(CommandError, match="cannot write"):
        call_command("export_run", "1", out=tmp_path / "no" / "x.zip", stdout=io.StringIO())
    assert list(tmp_path.iterdir()) == []
