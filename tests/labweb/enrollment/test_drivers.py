"""Driver source is read, proposed by one person and approved by another, or nothing is written."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from threading import BoundedSemaphore

import msgspec
import pytest
from django.core.management import CommandError, call_command
from django.db import IntegrityError, connection, transaction
from django.test.utils import CaptureQueriesContext

from labweb.accounts.models import AuditEntry
from labweb.approvals import services
from labweb.approvals.models import ApprovalRequest, Decision
from labweb.common import clock
from labweb.common.signatures import signing
from labweb.domain.enrollment.driver_bundle import decode_bundle, digest_of
from labweb.domain.errors import ConformanceError, ForbiddenError, StateError
from labweb.domain.messages.devices_and_drivers import DriverApproval, Signed
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.models import DriverVersion
from labweb.enrollment.services import driver_versions
from tests.builders import Bench, a_user
from tests.drivers.catalog.hostile import traps
from tests.labweb.enrollment.driver_texts import TIMER, approved, proposed, timer
from tests.labweb.web import call, code_of, read, signed_in


def test_source_is_read_before_a_transaction_is_open(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    client, read_it, open_blocks = (
        signed_in(bench.people["admin"]),
        driver_versions.inspect_text,
        [],
    )

    def noting(module: str, text: str) -> driver_versions.CatalogDriver:
        open_blocks.append(len(connection.atomic_blocks))
        return read_it(module, text)

    monkeypatch.setattr(driver_versions, "inspect_text", noting)
    outside = len(connection.atomic_blocks)
    told = {"module": TIMER, "source": timer(), "note": "better"}
    assert call(client, "POST", "/api/v1/drivers", told).status_code == 201
    assert open_blocks == [outside]


def test_a_driver_is_proposed_by_one_person_and_approved_by_another(bench: Bench) -> None:
    version = proposed(bench, timer())
    assert (version.state, version.origin, version.approval) == ("proposed", "upload", {})
    assert version.digest == digest_of(version.sources)
    request = ApprovalRequest.objects.get(driver_id=version.id)
    assert (request.plan_digest, request.run_id) == (version.digest, None)
    version = services.decide_driver(
        version.id, actor=bench.people["approver"], is_approved=True, comment="read it"
    )
    assert version.state == "approved"
    assert Decision.objects.get(request=request).meaning == "approves the driver"
    signed = msgspec.convert(version.approval, Signed)
    assert signing.is_signed_by(signing.public_key(), signed.body.encode(), signed.signature)
    approval = msgspec.json.decode(signed.body, type=DriverApproval)
    assert approval.digest == version.digest
    assert approval.proposed_by == str(bench.people["admin"].pk)
    assert approval.approved_by == str(bench.people["approver"].pk)
    kinds = AuditEntry.objects.filter(subject=str(version.id)).values_list("action", flat=True)
    assert list(kinds.order_by("id")) == ["driver.propose", "driver.approve"]


def test_nobody_approves_what_they_brought(bench: Bench) -> None:
    version = proposed(bench, timer())
    with pytest.raises(ForbiddenError) as refusal:
        services.decide_driver(
            version.id, actor=bench.people["admin"], is_approved=True, comment="mine"
        )
    assert refusal.value.code == "approval.own_request"
    version.refresh_from_db()
    assert version.state == "proposed"
    with pytest.raises(IntegrityError), transaction.atomic():
        DriverVersion.objects.filter(pk=version.id).update(
            approved_by=bench.people["admin"], state="approved"
        )
    with pytest.raises(IntegrityError), transaction.atomic():
        DriverVersion.objects.filter(pk=version.id).update(state="approved")


@pytest.mark.parametrize("role", ["observer", "chemist", "approver"])
def test_only_who_may_submit_brings_drivers(bench: Bench, role: str) -> None:
    with pytest.raises(ForbiddenError):
        services.submit_driver(TIMER, timer(), note="", actor=bench.people[role])
    assert not DriverVersion.objects.filter(origin="upload").exists()


def test_what_was_changed_after_it_was_proposed_is_not_signed(bench: Bench) -> None:
    version = proposed(bench, timer())
    DriverVersion.objects.filter(pk=version.id).update(sources={TIMER: timer(3)})
    with pytest.raises(StateError) as refusal:
        services.decide_driver(
            version.id, actor=bench.people["approver"], is_approved=True, comment=""
        )
    assert refusal.value.code == "driver.digest"
    version.refresh_from_db()
    assert (version.state, version.approval) == ("proposed", {})
    assert ApprovalRequest.objects.get(driver_id=version.id).state == "open"


@pytest.mark.parametrize(
    "name", ["import side effect", "metaclass", "decorator", "default argument", "ten megabytes"]
)
def test_a_hostile_driver_is_refused_with_every_finding_and_nothing_is_written(
    bench: Bench, tmp_path: Path, name: str
) -> None:
    canary = tmp_path / "canary"
    before = DriverVersion.objects.count()
    with pytest.raises(ConformanceError) as refusal:
        proposed(bench, traps(canary)[name].decode())
    assert refusal.value.findings
    assert all(finding.context["suggestion"] for finding in refusal.value.findings)
    assert not canary.exists()
    assert DriverVersion.objects.count() == before
    assert not ApprovalRequest.objects.filter(driver_id__isnull=False).exists()


def test_the_same_source_is_not_proposed_twice_and_a_rejected_one_may_come_again(
    bench: Bench,
) -> None:
    version = proposed(bench, timer())
    with pytest.raises(StateError) as refusal:
        proposed(bench, timer())
    assert refusal.value.code == "driver.known"
    services.decide_driver(
        version.id, actor=bench.people["approver"], is_approved=False, comment="no simulator"
    )
    assert proposed(bench, timer()).id == version.id
    version.refresh_from_db()
    assert version.state == "proposed"


def test_a_version_that_a_device_uses_is_not_withdrawn(bench: Bench) -> None:
    admin = bench.people["admin"]
    with pytest.raises(StateError) as refusal:
        services.withdraw_driver(bench.device("timer_1").driver_id, actor=admin, reason="old")
    assert refusal.value.code == "driver.in_use"
    version = approved(bench, timer())
    gone = services.withdraw_driver(version.id, actor=admin, reason="drifts")
    assert (gone.state, gone.approval) == ("withdrawn", {})


def test_a_host_gets_the_pieces_of_what_its_devices_use_and_of_nothing_else(bench: Bench) -> None:
    used = bench.device("pump_1").driver
    parts = enrollment_services.parts_of(bench.host.id, used.digest)
    data = b"".join(part.data for part in parts)
    assert decode_bundle(data, used.digest) == used.sources
    assert parts[0].approval is not None
    assert [part.index for part in parts] == list(range(parts[0].count))
    other = approved(bench, timer())
    (refused,) = enrollment_services.parts_of(bench.host.id, other.digest)
    assert refused.problem
    assert not refused.data


def test_a_release_vouches_for_its_own_drivers(bench: Bench) -> None:
    version = bench.device("pump_1").driver
    signed = msgspec.convert(version.approval, Signed)
    approval = msgspec.json.decode(signed.body, type=DriverApproval)
    assert (approval.origin, approval.proposed_by, approval.approved_by) == ("release", "", "")


# --- the doors ---


def test_a_driver_goes_through_the_rest_interface(bench: Bench) -> None:
    admin, approver = (signed_in(bench.people[role]) for role in ("admin", "approver"))
    body = {"module": TIMER, "source": timer(), "note": "better"}
    answer = call(admin, "POST", "/api/v1/drivers", body)
    assert answer.status_code == 201
    made = json.loads(answer.content)
    assert (made["state"], made["can"]["decide"]) == ("proposed", False)
    path = f"/api/v1/drivers/{made['id']}"
    assert read(approver, path)["can"]["decide"] is True
    assert read(approver, path)["sources"][TIMER] == timer()
    decision = {"is_approved": True, "comment": "read it"}
    assert code_of(call(admin, "POST", f"{path}/decision", decision)) == "approval.own_request"
    done = json.loads(call(approver, "POST", f"{path}/decision", decision).content)
    assert (done["state"], done["approved_by"]) == ("approved", "Approver Person")
    rows = read(approver, "/api/v1/drivers")["drivers"]
    assert {row["id"]: row["state"] for row in rows}[made["id"]] == "approved"
    request = ApprovalRequest.objects.get(driver_id=made["id"])
    assert read(approver, f"/api/v1/approvals/{request.id}", 404)["code"] == "approval.not_found"


def test_more_drivers_than_the_server_reads_wait_and_are_told_so(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver_versions, "_AT_ONCE", BoundedSemaphore(1))
    monkeypatch.setattr(driver_versions, "WAIT_S", 0.01)
    admin, body = signed_in(bench.people["admin"]), {"module": TIMER, "source": timer()}
    with driver_versions._AT_ONCE:
        answer = call(admin, "POST", "/api/v1/drivers/reading", body)
        assert (answer.status_code, code_of(answer)) == (423, "driver.busy")
    assert call(admin, "POST", "/api/v1/drivers/reading", body).status_code == 200


@pytest.mark.parametrize("module", ["-x", "--json", "a" * 200_000, "drivers.virtual." + "a" * 200])
def test_a_module_that_is_no_name_is_a_finding(bench: Bench, module: str) -> None:
    for path in ("drivers", "drivers/reading"):
        body = {"module": module, "source": timer()}
        answer = call(signed_in(bench.people["admin"]), "POST", f"/api/v1/{path}", body)
        found = json.loads(answer.content)
        assert (answer.status_code, found["code"]) == (422, "driver.conformance")
        assert [one["code"] for one in found["findings"]] == ["driver.no_module"]


def test_a_null_character_that_an_escape_hides_reaches_no_database(bench: Bench) -> None:
    said, setting = '"""One timer of the edge host."""', '"""A timer has nothing to set."""'
    hidden = {said: r'"""One \0 timer."""', setting: setting + '\n\n    end: str = "\\0"'}
    version = proposed(bench, timer(4, **hidden))
    assert version.spec["doc"] == "One ? timer."
    assert version.spec["config"][0]["default"] is None
    assert version.state == "proposed"


def test_of_two_who_bring_one_source_at_the_same_moment_the_second_is_refused(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other is through between the second one's look and the second one's write."""
    other = a_user("admin", on=bench.node("lab"), name="other")
    made: list[DriverVersion] = []

    def meanwhile() -> datetime:
        if not made:
            made.append(DriverVersion())
            made[0] = services.submit_driver(TIMER, timer(), note="first", actor=other)
        return clock.now()

    monkeypatch.setattr(driver_versions, "now", meanwhile)
    with pytest.raises(StateError) as refusal:
        proposed(bench, timer())
    assert refusal.value.code == "driver.known"
    assert refusal.value.context["id"] == str(made[0].id)


def test_an_answer_and_a_withdrawal_lock_the_version_first(bench: Bench) -> None:
    """In another order two of them at one moment would wait for each other."""
    one, two = proposed(bench, timer(1)), proposed(bench, timer(2))
    with CaptureQueriesContext(connection) as answering:
        services.decide_driver(one.id, actor=bench.people["approver"], is_approved=True, comment="")
    with CaptureQueriesContext(connection) as withdrawing:
        services.withdraw_driver(two.id, actor=bench.people["admin"], reason="old")
    for queries in (answering, withdrawing):
        first = next(
            one["sql"] for one in queries if " UPDATE" in one["sql"] and "FOR " in one["sql"]
        )
        assert 'FROM "enrollment_driverversion"' in first


@pytest.mark.parametrize(
    ("source", "code"),
    [("import os\n", "driver.conformance"), ("a = '\0'\n", "http.parse_error")],
)
def test_a_refusal_over_rest_lists_what_is_wrong(bench: Bench, source: str, code: str) -> None:
    body = {"module": TIMER, "source": source}
    answer = call(signed_in(bench.people["admin"]), "POST", "/api/v1/drivers", body)
    assert answer.status_code in {400, 422}
    assert code_of(answer) == code
    findings = json.loads(answer.content)["findings"]
    assert (code == "driver.conformance") == bool(findings)


def test_the_command_proposes_a_file_or_prints_every_finding(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "virtual" / "timer.py"
    path.parent.mkdir()
    path.write_text(timer(4))
    call_command("register_driver", str(path), "--user", "admin")
    assert DriverVersion.objects.get(origin="upload").module == TIMER
    path.write_text("import os\nimport numpy\n")
    with pytest.raises(CommandError) as refusal:
        call_command("register_driver", str(path), "--user", "admin")
    assert "drivers/virtual/timer.py:2: numpy is not among" in str(refusal.value)
    path.write_bytes(b"\xff")
    with pytest.raises(CommandError, match="not UTF-8"):
        call_command("register_driver", str(path), "--user", "admin")
