"""What the pages of drivers show: readings, changes, requests, and who has which version."""

from __future__ import annotations

import json
from typing import Any

import pytest
from django.db import connection
from django.test.utils import CaptureQueriesContext

from labweb.accounts.models import User
from labweb.approvals.models import ApprovalRequest
from labweb.common.clock import now
from labweb.enrollment.models import DriverVersion
from labweb.fleet.services import driver_replacement
from tests.builders import Bench, a_user, an_edge
from tests.labweb.enrollment.driver_texts import TIMER, approved, proposed, timer
from tests.labweb.web import call, code_of, read, signed_in


def detail(bench: Bench, version: DriverVersion, role: str = "admin") -> dict[str, Any]:
    return read(signed_in(bench.people[role]), f"/api/v1/drivers/{version.id}")


def place(bench: Bench, version: DriverVersion, role: str = "admin") -> dict[str, Any]:
    (found,) = detail(bench, version, role)["places"]
    return dict(found)


def test_a_list_of_more_versions_costs_no_more_queries(bench: Bench) -> None:
    admin, costs = signed_in(bench.people["admin"]), []
    for version in (1, 2):
        proposed(bench, timer(version))
        with CaptureQueriesContext(connection) as queries:
            read(admin, "/api/v1/drivers")
        costs.append(len(queries))
    assert costs[0] == costs[1]


def test_source_is_read_with_its_form_and_nothing_is_written(bench: Bench) -> None:
    before = DriverVersion.objects.count()
    admin = signed_in(bench.people["admin"])
    body = {"module": TIMER, "source": timer(7)}
    answer = call(admin, "POST", "/api/v1/drivers/reading", body)
    found = json.loads(answer.content)
    assert (answer.status_code, found["class_name"], found["known"]) == (200, "HostTimer", None)
    wait = next(action for action in found["actions"] if action["name"] == "wait")
    assert wait["schema"]["properties"]["duration_s"]["x-unit"] == "s"
    assert DriverVersion.objects.count() == before
    assert not ApprovalRequest.objects.exists()
    version = proposed(bench, timer(7))
    again = json.loads(call(admin, "POST", "/api/v1/drivers/reading", body).content)
    assert again["known"] == {"id": str(version.id), "state": "proposed"}
    assert found["digest"] == version.digest


def test_every_finding_has_its_line_and_what_to_write_instead(bench: Bench) -> None:
    admin = signed_in(bench.people["admin"])
    source = timer() + "\nimport numpy\nprint(1)\n"
    body = {"module": TIMER, "source": source}
    answer = call(admin, "POST", "/api/v1/drivers/reading", body)
    found = {one["code"]: one for one in json.loads(answer.content)["findings"]}
    assert {"driver.drv007", "driver.drv011"} <= found.keys()
    last = source.count("\n")
    assert found["driver.drv007"]["context"]["line"] == last
    assert found["driver.drv011"]["context"]["line"] == last - 1
    assert all(one["context"]["suggestion"] for one in found.values())


@pytest.mark.parametrize("role", ["observer", "chemist", "approver"])
def test_only_who_may_bring_drivers_has_source_read(bench: Bench, role: str) -> None:
    body = {"module": TIMER, "source": timer()}
    answer = call(signed_in(bench.people[role]), "POST", "/api/v1/drivers/reading", body)
    assert (answer.status_code, code_of(answer)) == (403, "governance.forbidden")


def test_two_versions_are_compared_line_by_line(bench: Bench) -> None:
    one, two = proposed(bench, timer(1)), proposed(bench, timer(2))
    admin = signed_in(bench.people["admin"])
    (module,) = read(admin, f"/api/v1/drivers/{two.id}/changes/{one.id}")["modules"]
    assert (module["module"], module["removed_count"], module["added_count"]) == (TIMER, 1, 1)
    signs = {line["sign"]: line["text"] for line in module["hunks"][-1]}
    assert (signs["-"], signs["+"]) == ("# version 1", "# version 2")
    assert read(admin, f"/api/v1/drivers/{one.id}/changes/{one.id}")["modules"] == []
    nobody = "00000000-0000-0000-0000-000000000000"
    assert read(admin, f"/api/v1/drivers/{one.id}/changes/{nobody}", 404)["code"] == (
        "driver.not_found"
    )


@pytest.mark.parametrize(("role", "may"), [("chemist", False), ("approver", True)])
def test_only_who_brings_approves_or_gives_drivers_reads_their_source(
    bench: Bench, role: str, may: bool
) -> None:
    one, two = proposed(bench, timer(1)), proposed(bench, timer(2))
    shown = detail(bench, two, role)
    assert (TIMER in shown["sources"], shown["can"]["read"]) == (may, may)
    assert shown["actions"], "what it does is no secret"
    client = signed_in(bench.people[role])
    path = f"/api/v1/drivers/{two.id}/changes/{one.id}"
    assert call(client, "GET", path).status_code == (200 if may else 403)


def test_a_right_on_a_part_of_the_lab_offers_no_answer_about_drivers(bench: Bench) -> None:
    """Drivers belong to no part: an answer needs the right on all of the lab."""
    version = proposed(bench, timer())
    a_user("admin", on=bench.node("bench_1"), name="bencher")
    there = signed_in(User.objects.get(username="bencher"))
    shown = read(there, f"/api/v1/drivers/{version.id}")
    assert shown["can"] == {"read": False, "decide": False, "withdraw": False}
    (row,) = [
        row for row in read(there, "/api/v1/drivers")["drivers"] if row["id"] == str(version.id)
    ]
    assert row["can"] == shown["can"]
    assert detail(bench, version, "approver")["can"]["decide"]


def test_the_request_of_a_version_is_shown_until_its_answer_and_after(bench: Bench) -> None:
    version = proposed(bench, timer())
    asked = detail(bench, version)["request"]
    assert (asked["state"], asked["decision"]) == ("open", None)
    approver = signed_in(bench.people["approver"])
    needs = read(approver, "/api/v1/home")["needs_you"]
    assert [one["url"] for one in needs if one["kind"] == "approval"] == [f"/drivers/{version.id}"]
    counts = read(approver, "/api/v1/session")["lab"]["counts"]
    assert (counts["drivers_open"], counts["approvals_open"]) == (1, 0)
    decision = {"is_approved": False, "comment": "no simulator"}
    call(approver, "POST", f"/api/v1/drivers/{version.id}/decision", decision)
    answered = detail(bench, version)["request"]
    assert answered["decision"]["comment"] == "no simulator"
    assert read(approver, "/api/v1/session")["lab"]["counts"]["drivers_open"] == 0


def test_a_request_whose_time_is_over_needs_nobody(bench: Bench) -> None:
    version = proposed(bench, timer())
    ApprovalRequest.objects.filter(driver_id=version.id).update(expires_at=now())
    assert detail(bench, version)["request"]["state"] == "expired"
    approver = signed_in(bench.people["approver"])
    assert read(approver, "/api/v1/session")["lab"]["counts"]["drivers_open"] == 0
    assert not [
        one for one in read(approver, "/api/v1/home")["needs_you"] if "/drivers/" in one["url"]
    ]


def test_a_place_tells_how_far_a_replacement_has_come(bench: Bench) -> None:
    edge, version = an_edge(bench), approved(bench, timer())
    admin = bench.people["admin"]
    before = bench.device("timer_1").driver
    assert place(bench, version)["driver"]["next"] is None
    driver_replacement.replace_driver(
        bench.device("timer_1").id, version.id, actor=admin, reason="better"
    )
    shown = place(bench, version)
    assert shown["driver"]["version_id"] == str(before.id)
    assert shown["driver"]["next"] == {
        "version_id": str(version.id),
        "digest": version.digest,
        "is_ready": False,
    }
    assert shown["host"]["name"] == bench.host.name
    device = bench.device("timer_1")
    edge.report("driver_ready", None, device_id=str(device.id), digest=version.digest)
    shown = place(bench, version)
    assert (shown["driver"]["version_id"], shown["driver"]["next"]) == (str(version.id), None)


def test_only_who_may_admit_may_change_a_version(bench: Bench) -> None:
    version = bench.device("timer_1").driver
    assert place(bench, version)["can_change"] is True
    assert place(bench, version, "chemist")["can_change"] is False
