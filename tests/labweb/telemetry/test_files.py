"""Files are kept by their digest; what they tell becomes readings, or nothing is kept."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import os
from pathlib import Path
from typing import Any
from uuid import UUID

import pyarrow.parquet as pq  # type: ignore[import-untyped]
import pytest
from django.core.files.uploadedfile import SimpleUploadedFile
from django.db import DatabaseError
from django.db.transaction import atomic
from django.test import Client, TestCase
from pytest_django import Settings

from labweb.telemetry import selectors
from labweb.telemetry import services as telemetry_services
from labweb.telemetry.models import File, Incoming, Reading
from labweb.telemetry.services import kept_files
from tests.builders import Bench, a_started_run, a_user, an_edge, to_transfer
from tests.labweb.instrument_files import SPECTRUM, TRACE, an_mzml
from tests.labweb.web import Keyed, call, code_of, read, signed_in

API = "/api/v1"


@pytest.fixture(autouse=True)
def store(settings: Settings, tmp_path: Path) -> Path:
    settings.DATA_DIR = tmp_path
    return tmp_path / "files"


@pytest.fixture
def chemist(bench: Bench) -> Client:
    return signed_in(bench.people["chemist"])


def send(
    client: Client,
    raw: bytes | str,
    *,
    status: int = 201,
    **form: Any,  # noqa: ANN401 - fields of the form
) -> dict[str, Any]:
    content = raw.encode() if isinstance(raw, str) else raw
    name = form.pop("name", "trace.csv")
    file = SimpleUploadedFile(name, content, form.pop("media_type", "text/html"))
    answer = client.post(f"{API}/files", {"format": "csv", "file": file} | form)
    told: dict[str, Any] = json.loads(answer.content)
    found = answer.status_code
    if found == 202:
        found, told = worked_off(client, told)
    assert found == status, told
    return told


def worked_off(client: Client, told: dict[str, Any]) -> tuple[int, dict[str, Any]]:
    """Do what the worker does, and answer as who waits for it is told."""
    assert (told["state"], told["file_id"]) == ("pending", None)
    with TestCase.captureOnCommitCallbacks(execute=True):
        telemetry_services.read_incoming(UUID(told["id"]))
    ended = read(client, f"{API}/files/incoming/{told['id']}")
    if ended["state"] == "refused":
        return 422, ended
    return 201, read(client, f"{API}/files/{ended['file_id']}")


def kept(store: Path) -> list[str]:
    return sorted(path.name for path in store.rglob("*") if path.is_file())


def test_a_file_is_kept_whole_with_its_readings(bench: Bench, chemist: Client, store: Path) -> None:
    flask = bench.node("flask_1")
    told = send(chemist, TRACE, resource=flask.pk)
    digest = hashlib.sha256(TRACE.encode()).hexdigest()
    assert (told["sha256"], told["size_bytes"]) == (digest, len(TRACE.encode()))
    assert (told["media_type"], told["kept_by"]) == ("text/csv", "Chemist Person")
    assert [reading["name"] for reading in told["readings"]] == ["absorbance", "temperature"]
    assert {reading["file_sha256"] for reading in told["readings"]} == {digest}
    assert {reading["resource_id"] for reading in told["readings"]} == {str(flask.pk)}
    (series,) = told["series"]
    assert kept(store) == sorted([digest, series["sha256"]])
    rows = pq.read_table(selectors.path_of(series["sha256"]))
    assert rows.column("absorbance").to_pylist() == [0.10, 0.15, 0.21]


def test_a_download_is_the_bytes_with_their_checksum(bench: Bench, chemist: Client) -> None:
    told = send(chemist, TRACE, resource=bench.node("flask_1").pk, name='../a "b"\u00b5.csv')
    answer = call(chemist, "GET", f"{API}/files/{told['id']}/content")
    assert answer.content == TRACE.encode()
    digest = base64.b64encode(hashlib.sha256(TRACE.encode()).digest()).decode()
    assert answer["Repr-Digest"] == f"sha-256=:{digest}:"
    assert answer["Content-Length"] == str(len(answer.content))
    assert answer["Content-Disposition"] == "attachment; filename*=utf-8''a%20%22b%22%C2%B5.csv"
    assert answer["Content-Security-Policy"] == "sandbox; default-src 'none'"
    assert answer["X-Content-Type-Options"] == "nosniff"


def test_a_browser_brings_a_file_with_the_token_of_its_session_alone(bench: Bench) -> None:
    browser = Keyed(enforce_csrf_checks=True)
    browser.force_login(bench.people["chemist"])
    browser.get(f"{API}/session")
    token = browser.cookies["csrftoken"].value
    for header, status in ((token, 202), ("x" * len(token), 403)):
        form = {
            "format": "csv",
            "resource": bench.node("flask_1" if status == 202 else "reactor_1").pk,
            "file": SimpleUploadedFile("trace.csv", TRACE.encode()),
        }
        answer = browser.post(f"{API}/files", form, headers={"X-CSRFToken": header})
        assert answer.status_code == status, answer.content
    assert Incoming.objects.count() == 1


def test_a_file_that_is_damaged_on_disk_is_not_sent(bench: Bench, chemist: Client) -> None:
    told = send(chemist, TRACE, resource=bench.node("flask_1").pk)
    path = selectors.path_of(told["sha256"])
    path.chmod(0o600)
    path.write_bytes(TRACE.replace("0.15", "0.51").encode())
    answer = call(chemist, "GET", f"{API}/files/{told['id']}/content")
    assert (answer.status_code, code_of(answer)) == (409, "file.damaged")
    path.unlink()
    answer = call(chemist, "GET", f"{API}/files/{told['id']}/content")
    assert code_of(answer) == "file.damaged"


def test_who_brings_the_bytes_again_puts_a_damaged_file_right(
    bench: Bench, chemist: Client
) -> None:
    told = send(chemist, TRACE, resource=bench.node("flask_1").pk)
    path = selectors.path_of(told["sha256"])
    path.chmod(0o600)
    path.write_bytes(b"nothing of it")
    send(chemist, TRACE, resource=bench.node("reactor_1").pk)
    assert call(chemist, "GET", f"{API}/files/{told['id']}/content").content == TRACE.encode()


def test_a_file_that_is_wrong_leaves_nothing_behind(
    bench: Bench, chemist: Client, store: Path
) -> None:
    wrong = TRACE.replace("0.15", "much")
    told = send(chemist, wrong, status=422, resource=bench.node("flask_1").pk)
    assert told["code"] == "instrument.invalid"
    assert [f["subject"] for f in told["findings"]] == ["line 4, absorbance"]
    assert not File.objects.exists()
    assert kept(store) == []


def test_bytes_are_taken_back_when_the_record_fails(
    bench: Bench, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise DatabaseError("the disk of the database is full")

    monkeypatch.setattr("labweb.accounts.services.write_audit", broken)
    upload = kept_files.Upload(
        stream=io.BytesIO(TRACE.encode()), name="a.csv", media_type="", format="csv",
        resource=bench.node("flask_1"),
    )  # fmt: skip
    with pytest.raises(DatabaseError, match="full"), atomic():
        kept_files.keep_file(upload, lab=bench.lab, actor=bench.people["chemist"])
    assert not File.objects.exists()
    assert kept(store) == []


def test_the_same_bytes_for_the_same_subject_are_refused(bench: Bench, chemist: Client) -> None:
    flask, reactor = bench.node("flask_1"), bench.node("reactor_1")
    first = send(chemist, TRACE, resource=flask.pk)
    told = send(chemist, TRACE, status=409, resource=flask.pk, name="other.csv")
    assert (told["code"], told["context"]["file_id"]) == ("file.exists", first["id"])
    assert send(chemist, TRACE, resource=reactor.pk)["sha256"] == first["sha256"]


def test_a_file_of_a_job_belongs_to_its_device(bench: Bench, chemist: Client) -> None:
    job = to_transfer(a_started_run(bench), an_edge(bench)).job
    told = send(chemist, SPECTRUM, job=job.pk, format="jcamp", name="uv.jdx")
    assert (told["job_id"], told["device_id"]) == (str(job.pk), str(job.device_id))
    (reading,) = read(chemist, f"{API}/readings?job={job.pk}")["readings"]
    assert reading["measured_at"].startswith("2026-03-01T08:30:00")
    other = bench.device("ph_1").pk
    told = send(chemist, TRACE, status=422, job=job.pk, device=other)
    assert told["code"] == "file.other_device"


def test_a_file_may_be_kept_and_not_read(bench: Bench, chemist: Client) -> None:
    told = send(
        chemist, b"\x89PNG", resource=bench.node("flask_1").pk, format="none", name="a.png",
        media_type="image/png",
    )  # fmt: skip
    assert (told["readings"], told["media_type"]) == ([], "image/png")


@pytest.mark.parametrize(
    ("form", "code"),
    [
        ({}, "file.no_subject"),
        ({"resource": "flask_1", "format": "guess"}, "file.format"),
        ({"resource": "flask_1", "format": ""}, "file.format"),
        ({"resource": "flask_1", "raw": b""}, "file.empty"),
        ({"resource": "flask_1", "colour": "red"}, "http.body"),
        ({"resource": "not-an-id"}, "http.query"),
        ({"resource": "flask_1", "raw": b"\0" * 100, "format": "neware"}, "instrument.invalid"),
    ],
)
def test_a_wrong_form_is_refused(
    bench: Bench, chemist: Client, form: dict[str, Any], code: str
) -> None:
    if form.get("resource") == "flask_1":
        form = {**form, "resource": bench.node("flask_1").pk}
    told = send(chemist, form.pop("raw", TRACE) if "raw" in form else TRACE, status=422, **form)
    assert told["code"] == code
    assert not File.objects.exists()


def test_a_file_beyond_the_bound_is_broken_off(
    bench: Bench, chemist: Client, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("labweb.records.api.files.MOST_BYTES", 50)
    told = send(chemist, TRACE, status=422, resource=bench.node("flask_1").pk)
    assert told["code"] == "file.too_large"
    monkeypatch.setattr("labweb.records.api.files.MOST_BYTES", 2**20)
    monkeypatch.setattr(kept_files, "MOST_BYTES", 50)
    told = send(chemist, TRACE, status=422, resource=bench.node("flask_1").pk)
    assert told["code"] == "file.too_large"
    assert not list(store.rglob("*"))


def test_files_and_readings_outside_the_subtree_are_as_if_not_there(
    bench: Bench, chemist: Client
) -> None:
    guest = signed_in(a_user("chemist", on=bench.node("balance_1"), name="guest"))
    water, flask = bench.node("water").pk, bench.node("flask_1").pk
    pump = bench.device("pump_1").pk
    hidden = [send(chemist, TRACE, resource=water), send(chemist, TRACE, device=pump)]
    shown = send(chemist, TRACE, resource=flask)
    assert [row["id"] for row in read(guest, f"{API}/files")["files"]] == [shown["id"]]
    seen = {row["file_id"] for row in read(guest, f"{API}/readings")["readings"]}
    assert seen == {shown["id"]}
    for row in hidden:
        for path in (row["id"], f"{row['id']}/content", f"{row['series'][0]['id']}/content"):
            assert read(guest, f"{API}/files/{path}", status=404)["code"] == "file.not_found"
    assert send(guest, SPECTRUM, status=404, resource=water)["code"] == "resource.not_found"
    assert send(guest, SPECTRUM, status=404, device=pump)["code"] == "device.not_found"
    job = to_transfer(a_started_run(bench), an_edge(bench)).job
    assert send(guest, SPECTRUM, status=404, job=job.pk)["code"] == "job.not_found"


def test_an_observer_may_look_and_not_bring(bench: Bench, chemist: Client) -> None:
    observer = signed_in(bench.people["observer"])
    told = send(observer, TRACE, status=403, resource=bench.node("flask_1").pk)
    assert told["code"] == "governance.forbidden"
    kept = send(chemist, TRACE, resource=bench.node("flask_1").pk)
    assert read(observer, f"{API}/files/{kept['id']}")["sha256"] == kept["sha256"]


@pytest.mark.parametrize("model", [File, Reading])
def test_a_kept_row_cannot_be_changed_or_removed(
    bench: Bench, chemist: Client, model: type[File | Reading]
) -> None:
    send(chemist, TRACE, resource=bench.node("flask_1").pk)
    with pytest.raises(DatabaseError, match="append-only"), atomic():
        model.objects.update(name="other")
    with pytest.raises(DatabaseError, match="append-only"), atomic():
        model.objects.all()._raw_delete("default")


def test_lists_are_narrowed_and_bounded(bench: Bench, chemist: Client) -> None:
    flask, reactor = bench.node("flask_1").pk, bench.node("reactor_1").pk
    first = send(chemist, TRACE, resource=flask)
    second = send(chemist, SPECTRUM, resource=reactor, format="jcamp")
    rows = read(chemist, f"{API}/files?resource={reactor}")["files"]
    assert [row["id"] for row in rows] == [second["id"]]
    rows = read(chemist, f"{API}/readings?file={first['id']}&limit=1")["readings"]
    assert [row["index"] for row in rows] == [1]
    assert read(chemist, f"{API}/files?sha256={first['sha256']}")["files"][0]["id"] == first["id"]
    assert read(chemist, f"{API}/files?resource=x", status=422)["code"] == "http.query"


def test_the_points_of_a_series_are_those_of_the_file(bench: Bench, chemist: Client) -> None:
    told = send(chemist, TRACE, resource=bench.node("flask_1").pk)
    by_name = {reading["name"]: reading["id"] for reading in told["readings"]}
    drawn = read(chemist, f"{API}/readings/{by_name['temperature']}/points")
    assert drawn["points"] == [[0.0, 25.0], [1.0, 25.1], [2.0, None]]
    assert (drawn["x"]["unit"], drawn["y"]["unit"], drawn["is_thinned"]) == ("s", "degC", False)


def test_a_long_series_is_thinned_and_keeps_its_peak(bench: Bench, chemist: Client) -> None:
    rows = [f"{n},{1000 if n == 77_777 else n % 7}" for n in range(150_000)]
    raw = "\n".join(["time (s),signal (1)", *rows, ""])
    told = send(chemist, raw, resource=bench.node("flask_1").pk)
    drawn = read(chemist, f"{API}/readings/{told['readings'][0]['id']}/points?points=400")
    assert (drawn["rows_count"], drawn["is_thinned"]) == (150_000, True)
    assert 200 <= len(drawn["points"]) <= 400
    assert [77_777.0, 1000.0] in drawn["points"]
    assert [x for x, _ in drawn["points"]] == sorted(x for x, _ in drawn["points"])


def test_one_of_several_spectra_is_drawn(bench: Bench, chemist: Client, tmp_path: Path) -> None:
    scans = [(0.1, [100.0, 101.0], [5.0, 7.0]), (0.2, [100.5, 102.0], [1.0, 9.0])]
    raw = an_mzml(tmp_path / "a.mzML", scans)
    told = send(chemist, raw, resource=bench.node("flask_1").pk, format="mzml", name="a.mzML")
    spectra = next(r for r in told["readings"] if r["name"] == "mass spectra")["id"]
    first = read(chemist, f"{API}/readings/{spectra}/points")
    assert first["points"] == [[100.0, 5.0], [101.0, 7.0]]
    number = first["scan"]["most"]
    second = read(chemist, f"{API}/readings/{spectra}/points?scan={number}")
    assert second["points"] == [[100.5, 1.0], [102.0, 9.0]]
    assert read(chemist, f"{API}/readings/{spectra}/points?scan=x", status=422)


def test_a_single_value_has_no_points(bench: Bench, chemist: Client, tmp_path: Path) -> None:
    raw = an_mzml(tmp_path / "a.mzML", [(0.1, [100.0], [5.0])])
    told = send(chemist, raw, resource=bench.node("flask_1").pk, format="mzml")
    one = next(reading for reading in told["readings"] if reading["value"] is not None)
    answer = read(chemist, f"{API}/readings/{one['id']}/points", status=422)
    assert answer["code"] == "reading.no_series"


def test_names_are_told_of_what_one_may_know(bench: Bench, chemist: Client) -> None:
    run = a_started_run(bench)
    job = run.jobs.order_by("index")[0]
    flask = bench.node("flask_1")
    send(chemist, TRACE, job=job.pk, resource=flask.pk)
    row = read(chemist, f"{API}/files")["files"][0]
    assert row["resource"] == {"id": str(flask.pk), "name": flask.name}
    assert row["device"]["name"] == job.device.name
    assert row["job"]["run"] == {"id": str(run.pk), "number": run.number}
    guest = signed_in(a_user("observer", on=flask, name="guest"))
    row = read(guest, f"{API}/files")["files"][0]
    assert (row["resource"]["name"], row["device"], row["job"]) == (flask.name, None, None)


def test_a_file_has_its_place_on_the_disk_before_anybody_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []

    def keep(handle: int) -> None:
        told.append(str(Path(f"/proc/self/fd/{handle}").readlink()))

    monkeypatch.setattr(os, "fsync", keep)
    (tmp_path / "raw").write_bytes(b"a curve")
    kept_files.move(tmp_path / "raw", tmp_path / "ab/whole")
    assert (tmp_path / "ab/whole").read_bytes() == b"a curve"
    assert told == [str(tmp_path / "ab"), str(tmp_path)]
