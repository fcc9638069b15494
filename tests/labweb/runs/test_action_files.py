"""A device hands a file over: named by the event, then brought by its host, then read."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import msgspec
import pytest
from pytest_django import Settings

from labweb.crutd import selectors as crutd_selectors
from labweb.domain.action_files import (
    UNKNOWN,
    WANTED,
    FileAsked,
    FileGone,
    FileOffer,
    FilePart,
    NamedFile,
)
from labweb.domain.errors import LabError
from labweb.domain.runs.host_journal.action_states import ActionReport
from labweb.enrollment import services as enrollment_services
from labweb.runs import services
from labweb.runs.api.run_details import render_run
from labweb.runs.models import Attempt, Run
from labweb.runs.services.action_files import REFUSED
from labweb.telemetry import selectors as telemetry_selectors
from labweb.telemetry import services as telemetry_services
from labweb.telemetry.models import File, Incoming, Reading
from labweb.workflows import services as workflow_services
from tests.builders import Bench
from tests.labweb.runs.hosts import Host

TABLE = b"time (s),absorbance (1)\n0,0.10\n1,0.15\n"
BROKEN = b"time (s),absorbance\n0,0.10\n"


@pytest.fixture
def lab(bench: Bench, settings: Settings, tmp_path: Path) -> Bench:
    settings.DATA_DIR = tmp_path
    return bench


def named(data: bytes, name: str = "trace.csv", form: str = "csv") -> NamedFile:
    digest = hashlib.sha256(data).hexdigest()
    return NamedFile(
        name=name, format=form, media_type="text/csv", size_bytes=len(data), sha256=digest
    )


def measured(
    lab: Bench, *files: NamedFile, sample: str | None = None, host: Host | None = None
) -> Attempt:
    """Have the balance weigh, and its host report files with that."""
    params: dict[str, Any] = {"device": str(lab.node("balance_1").id), "action": "weigh"}
    if sample is not None:
        params["sample"] = str(lab.node(sample).id)
    step = {"id": "m", "kind": "device_action", "params": params, "position": {"x": 0, "y": 0}}
    document = {"schema": "labweb.workflow/1", "name": "Measure", "steps": [step], "edges": []}
    chemist = lab.people["chemist"]
    workflow = workflow_services.create_workflow(
        lab.lab, name="Measure", document=document, actor=chemist
    )
    version = workflow_services.save_version(workflow.id, note="", actor=chemist)
    run = services.start_run(version, actor=chemist)
    host = host or Host(lab)
    assert services.dispatch_ready() == 1
    host.take()
    assert host.step(report=ActionReport(ok=True, evidence={"mass_mg": 1.0}, files=files))
    host.tell()
    return Attempt.objects.select_related("job__run").get(job__run=run)


def offered(lab: Bench, attempt: Attempt, data: bytes) -> str:
    offer = FileOffer(
        epoch=1,
        action_id=attempt.pk,
        device_id=attempt.job.device_id,
        sha256=hashlib.sha256(data).hexdigest(),
        size_bytes=len(data),
    )
    return services.offer_file(lab.host.id, offer)


def brought(lab: Bench, attempt: Attempt, data: bytes, sha256: str | None = None) -> str:
    part = FilePart(
        epoch=1,
        action_id=attempt.pk,
        device_id=attempt.job.device_id,
        sha256=sha256 or hashlib.sha256(data).hexdigest(),
        offset_bytes=0,
        size_bytes=len(data),
        data=data,
    )
    return services.take_file(lab.host.id, part, data)


def shown(attempt: Attempt, lab: Bench) -> list[dict[str, Any]]:
    run = Run.objects.get(pk=attempt.job.run_id)
    return list(msgspec.to_builtins(render_run(run, lab.people["chemist"]).files))


def test_a_file_is_missing_until_it_came_and_then_is_read_and_linked(lab: Bench) -> None:
    attempt = measured(lab, named(TABLE))
    assert attempt.job.state == "complete"
    (told,) = shown(attempt, lab)
    assert (told["name"], told["state"], told["file_id"]) == ("trace.csv", "awaited", None)
    assert services.files_asked(lab.host.id) == [
        FileAsked(
            action_id=attempt.pk,
            device_id=attempt.job.device_id,
            sha256=named(TABLE).sha256,
        )
    ]
    assert offered(lab, attempt, TABLE) == WANTED
    assert brought(lab, attempt, TABLE) == ""
    assert (offered(lab, attempt, TABLE), brought(lab, attempt, TABLE)) == ("", ""), "once"
    row = Incoming.objects.get()
    assert row.state == "pending"
    telemetry_services.read_incoming(row.pk)
    kept = File.objects.get(made_from=None)
    assert (kept.job_id, kept.device_id) == (attempt.job_id, attempt.job.device_id)
    assert kept.job is not None
    assert kept.job.run_id == attempt.job.run_id
    assert telemetry_selectors.path_of(kept.sha256).read_bytes() == TABLE
    assert Reading.objects.get().name == "absorbance"
    (told,) = shown(attempt, lab)
    assert (told["state"], told["file_id"]) == ("parsed", str(kept.pk))
    assert services.files_asked(lab.host.id) == []


@pytest.mark.parametrize("sample", ["flask_1", None])
def test_a_file_is_linked_to_the_sample_that_stands_on_the_device(
    lab: Bench, sample: str | None
) -> None:
    attempt = measured(lab, named(TABLE), sample=sample)
    brought(lab, attempt, TABLE)
    telemetry_services.read_incoming(Incoming.objects.get().pk)
    flask = lab.node("flask_1").id
    assert File.objects.get(made_from=None).resource_id == flask
    assert Reading.objects.get().resource_id == flask


def test_a_sample_that_does_not_stand_on_the_device_is_refused(lab: Bench) -> None:
    with pytest.raises(LabError) as refusal:
        measured(lab, named(TABLE), sample="flask_2")
    assert [finding.code for finding in refusal.value.findings] == ["plan.sample_elsewhere"]


def test_what_is_not_the_file_that_is_named_is_refused(lab: Bench) -> None:
    attempt = measured(lab, named(TABLE))
    other = TABLE.replace(b"0.15", b"0.16")
    assert offered(lab, attempt, other) == UNKNOWN
    assert brought(lab, attempt, other) == UNKNOWN
    assert Incoming.objects.get().state == "awaited", "it is missing as before"
    assert brought(lab, attempt, other, named(TABLE).sha256) == REFUSED
    assert brought(lab, attempt, TABLE[:-1], named(TABLE).sha256) == REFUSED
    assert File.objects.count() == 0
    (told,) = shown(attempt, lab)
    assert (told["state"], told["code"]) == ("lost", "file.lost"), "its host has dropped it"
    assert "not those that the action named" in told["message"]
    (ticket,) = crutd_selectors.open_tickets(lab.lab).filter(code="file.lost")
    assert attempt.job.device.name in ticket.message


def test_bytes_that_the_servers_disk_spoils_are_lost_and_open_a_ticket(
    lab: Bench, settings: Settings
) -> None:
    """The host has dropped its copy by then."""
    attempt = measured(lab, named(TABLE))
    assert brought(lab, attempt, TABLE) == ""
    row = Incoming.objects.get()
    path = Path(settings.DATA_DIR) / "files" / ".waiting" / str(row.pk)
    path.write_bytes(TABLE.replace(b"0.15", b"0.16"))
    services.read_file(row.pk)
    (told,) = shown(attempt, lab)
    assert (told["state"], told["code"]) == ("lost", "file.damaged")
    (ticket,) = crutd_selectors.open_tickets(lab.lab).filter(code="file.damaged")
    for word in ("trace.csv", attempt.job.device.name, f"run #{attempt.job.run.number}"):
        assert word in ticket.message
    assert "measure again" in ticket.message
    assert ticket.detail["sha256"] == named(TABLE).sha256
    services.read_file(row.pk)
    assert crutd_selectors.open_tickets(lab.lab).filter(code="file.damaged").count() == 1


@pytest.mark.parametrize("told", ["a spectrum", "Text/CSV; charset=utf-8", "text/" + "c" * 100])
def test_an_odd_media_type_of_an_old_journal_quarantines_nobody(lab: Bench, told: str) -> None:
    measured(lab, msgspec.structs.replace(named(TABLE), media_type=told))
    row = Incoming.objects.get()
    assert row.media_type in {"text/csv", "application/octet-stream"}
    assert enrollment_services.record_of(lab.host).quarantine == ""


def test_a_file_that_cannot_be_read_is_kept_and_says_why(lab: Bench) -> None:
    attempt = measured(lab, named(BROKEN))
    assert brought(lab, attempt, BROKEN) == ""
    telemetry_services.read_incoming(Incoming.objects.get().pk)
    kept = File.objects.get()
    assert (kept.format, kept.media_type, kept.job_id) == ("none", "text/csv", attempt.job_id)
    assert telemetry_selectors.path_of(kept.sha256).read_bytes() == BROKEN
    (told,) = shown(attempt, lab)
    assert (told["state"], told["code"], told["file_id"]) == (
        "refused", "instrument.invalid", str(kept.pk),
    )  # fmt: skip


def test_a_lost_file_is_on_the_record_and_opens_a_ticket_once(lab: Bench) -> None:
    attempt = measured(lab, named(TABLE))
    gone = FileGone(epoch=1, action_id=attempt.pk, sha256=named(TABLE).sha256, message="burnt")
    services.take_gone(lab.host.id, gone)
    services.take_gone(lab.host.id, gone)
    (told,) = shown(attempt, lab)
    assert (told["state"], told["code"], told["message"]) == ("lost", "file.lost", "burnt")
    (ticket,) = crutd_selectors.open_tickets(lab.lab).filter(code="file.lost")
    assert "trace.csv" in ticket.message
    assert brought(lab, attempt, TABLE) == "", "should it turn up after all, it counts"
    assert shown(attempt, lab)[0]["state"] == "pending"
    services.take_gone(lab.host.id, gone)
    assert shown(attempt, lab)[0]["state"] == "pending", "what is here is not lost"


def test_the_same_bytes_of_another_action_are_another_file(lab: Bench) -> None:
    host = Host(lab)
    first, second = (measured(lab, named(TABLE), host=host) for _ in range(2))
    for attempt in (first, second):
        assert brought(lab, attempt, TABLE) == ""
    for row in Incoming.objects.all():
        telemetry_services.read_incoming(row.pk)
    assert Incoming.objects.filter(state="parsed").count() == 2
    assert File.objects.filter(made_from=None).count() == 2


@pytest.mark.parametrize(
    "wrong",
    [
        {"name": "../x.csv"},
        {"sha256": "0" * 65},
    ],
)
def test_files_that_cannot_be_quarantine_the_host_that_names_them(
    lab: Bench, wrong: dict[str, str]
) -> None:
    with pytest.raises(AssertionError):
        measured(lab, msgspec.structs.replace(named(TABLE), **wrong))
    assert Incoming.objects.count() == 0
    assert enrollment_services.record_of(lab.host).quarantine == "host.bad_event"


def test_a_file_at_which_the_worker_ended_and_whose_bytes_are_gone_is_told_as_lost(
    lab: Bench, settings: Settings
) -> None:
    attempt = measured(lab, named(TABLE))
    assert brought(lab, attempt, TABLE) == ""
    row = Incoming.objects.get()
    Incoming.objects.update(tries=3)
    (Path(settings.DATA_DIR) / "files" / ".waiting" / str(row.pk)).unlink()
    services.read_file(row.pk)
    assert shown(attempt, lab)[0]["state"] == "lost"
    row.refresh_from_db()
    assert (row.code, row.ended_at is not None) == ("file.damaged", True)
    assert crutd_selectors.open_tickets(lab.lab).filter(code="file.damaged").count() == 1
