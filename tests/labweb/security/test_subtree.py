"""Who was given a subtree sees and touches that and nothing else.

```text
lab ── bench_1 ─┬─ balance_1 ── flask_1      the guest's subtree
                ├─ water, pumps, heater …    elsewhere
```
"""

from __future__ import annotations

from typing import Any

import pytest
from django.test import Client

from labweb.accounts.selectors import User
from labweb.crutd import services as crutd_services
from labweb.domain.crutd import operations
from labweb.resources.models import Lot
from labweb.runs.models import Run
from labweb.workflows import services as workflow_services
from labweb.workflows.models import WorkflowVersion
from tests.builders import HEAT, Bench, a_started_run, a_user, an_edge, dispatched
from tests.labweb.web import call, code_of, read, signed_in, weigh

API = "/api/v1"


@pytest.fixture
def guest(bench: Bench) -> User:
    return a_user("chemist", on=bench.node("balance_1"), name="guest")


@pytest.fixture
def client(guest: User) -> Client:
    return signed_in(guest)


def a_weighing(bench: Bench) -> WorkflowVersion:
    chemist = bench.people["chemist"]
    row = workflow_services.create_workflow(
        bench.lab, name="Weigh", document=weigh(bench), actor=chemist
    )
    return workflow_services.save_version(row.id, note="", actor=chemist)


def keys(rows: list[dict[str, Any]]) -> set[str]:
    return {row["key"] for row in rows}


def test_lists_hold_the_subtree_and_nothing_else(bench: Bench, client: Client) -> None:
    assert keys(read(client, f"{API}/resources")["resources"]) == {"balance_1", "flask_1"}
    assert keys(read(client, f"{API}/devices")["devices"]) == {"balance_1"}
    assert read(client, f"{API}/connections")["connections"] == []
    assert [row["name"] for row in read(client, f"{API}/steps")["devices"]] == ["Balance 1"]


def test_a_detail_outside_is_as_if_it_were_not_there(bench: Bench, client: Client) -> None:
    run = a_started_run(bench)
    outside = {
        f"{API}/resources/{bench.node('water').id}": "resource.not_found",
        f"{API}/resources/{bench.node('water').id}/lineage": "resource.not_found",
        f"{API}/resources/{bench.node('water').id}/provenance": "resource.not_found",
        f"{API}/resources/{bench.node('water').id}/conditions": "resource.not_found",
        f"{API}/lots/{Lot.objects.get(key='water_lot').id}/provenance": "lot.not_found",
        f"{API}/devices/{bench.device('pump_1').id}": "device.not_found",
        f"{API}/devices/{bench.device('pump_1').id}/telemetry": "device.not_found",
        f"{API}/devices/{bench.device('pump_1').id}/telemetry/curves": "device.not_found",
        f"{API}/devices/{bench.device('pump_1').id}/telemetry/export": "device.not_found",
        f"{API}/runs/{run.id}": "run.not_found",
        f"{API}/runs/{run.id}/events": "run.not_found",
        f"{API}/runs/{run.id}/log": "run.not_found",
        f"{API}/runs/{run.id}/provenance": "run.not_found",
        f"{API}/runs/{run.id}/crate": "run.not_found",
    }
    for path, code in outside.items():
        assert read(client, path, status=404)["code"] == code


def test_the_detail_inside_does_not_name_what_is_outside(bench: Bench, client: Client) -> None:
    move = operations.TransferLiquid(
        source_id=bench.node("water").id, target_id=bench.node("flask_1").id, amount_nl=1_000_000
    )
    crutd_services.carry_out(move, lab=bench.lab, actor_id=bench.people["chemist"].pk)
    flask = f"{API}/resources/{bench.node('flask_1').id}"
    detail = read(client, flask)
    assert detail["ports"] == []
    assert {s["name"] for s in detail["events"][0]["subjects"]} == {"elsewhere", "Flask 1"}
    names = {node["name"] for node in read(client, f"{flask}/lineage")["nodes"]}
    assert "elsewhere" in names
    assert bench.node("water").name not in {n for n in names if n != "Water W-0001"}


@pytest.mark.parametrize("text", ["pump", "water", "heater", "run #", "reactor"])
def test_search_finds_nothing_outside(bench: Bench, client: Client, text: str) -> None:
    a_started_run(bench)
    workflows = {"workflow"}
    found = read(client, f"{API}/search?q={text}")["results"]
    assert {row["kind"] for row in found} <= workflows


def test_search_finds_what_is_inside(bench: Bench, client: Client) -> None:
    found = read(client, f"{API}/search?q=balance")["results"]
    assert {(row["kind"], row["name"]) for row in found} == {
        ("resource", "Balance 1"),
        ("device", "Balance 1"),
    }


def test_home_runs_and_approvals_show_no_run_outside(bench: Bench, client: Client) -> None:
    a_started_run(bench)
    a_started_run(bench, HEAT)
    home = read(client, f"{API}/home")
    assert (home["running"], home["needs_you"], home["last_results"]) == ([], [], [])
    assert keys(home["devices"]) == {"balance_1"}
    assert read(client, f"{API}/runs")["runs"] == []
    assert read(client, f"{API}/approvals")["requests"] == []


def test_a_run_inside_may_be_started_seen_and_paused(bench: Bench, client: Client) -> None:
    version = a_weighing(bench)
    answer = call(client, "POST", f"{API}/runs", {"version_id": str(version.id)})
    assert answer.status_code == 201, answer.content
    run = Run.objects.get()
    assert read(client, f"{API}/runs")["runs"][0]["id"] == str(run.id)
    assert call(client, "POST", f"{API}/runs/{run.id}/pause", {}).status_code == 200


def test_a_run_outside_may_not_be_started_nor_touched(bench: Bench, client: Client) -> None:
    version = bench.version("Move 5 mL of water")
    answer = call(client, "POST", f"{API}/runs", {"version_id": str(version.id)})
    assert (answer.status_code, code_of(answer)) == (404, "workflow.no_version")
    assert not Run.objects.exists()
    run = a_started_run(bench)
    an_edge(bench)
    job = dispatched(run).job_id
    for path, body in (
        (f"runs/{run.id}/pause", {}),
        (f"runs/{run.id}/resume", {}),
        (f"runs/{run.id}/abort", {"reason": "mine"}),
        (f"jobs/{job}/resolve", {"answer": "happened", "note": "trust me"}),
    ):
        assert call(client, "POST", f"{API}/{path}", body).status_code == 404, path
    assert call(client, "POST", f"{API}/lab/stop", {}).status_code == 403
    assert Run.objects.get().state == "running"


def test_who_draws_in_a_part_of_the_lab_is_told_so_before_and_who_can_help(
    bench: Bench, client: Client
) -> None:
    me = read(client, f"{API}/session")["user"]
    assert "draw" in me["permissions"]
    assert me["lab_permissions"] == []
    own = a_weighing(bench).workflow
    assert read(client, f"{API}/workflows/{own.id}")["can_edit"] is False
    answer = call(client, "POST", f"{API}/workflows", {"name": "Mine"})
    assert (answer.status_code, code_of(answer)) == (403, "governance.forbidden")
    assert "guest may draw only in a part of the lab. Ask an admin" in answer.content.decode()
    chemist = signed_in(bench.people["chemist"])
    assert "draw" in read(chemist, f"{API}/session")["user"]["lab_permissions"]
    assert read(chemist, f"{API}/workflows/{own.id}")["can_edit"] is True


def test_a_check_tells_nothing_of_vessels_outside(bench: Bench, client: Client) -> None:
    document = bench.version("Move 5 mL of water").document
    document["steps"][0]["params"]["volume"] = "100 L"
    answer = call(client, "POST", f"{API}/workflows/check", {"document": document})
    assert answer.status_code == 200
    text = answer.content.decode()
    assert "governance.forbidden" in text
    assert "can give" not in text
    assert bench.node("reactor_1").name not in text


def test_what_is_moved_out_is_gone_with_the_next_request(bench: Bench, client: Client) -> None:
    flask = bench.unplug("flask_1")
    path = f"{API}/resources/{flask.id}"
    read(client, path)
    move = operations.TransferResource(
        resource_id=flask.id,
        from_id=bench.node("balance_1").id,
        to_id=bench.node("bench_1").id,
    )
    crutd_services.carry_out(move, lab=bench.lab, actor_id=bench.people["chemist"].pk)
    assert read(client, path, status=404)["code"] == "resource.not_found"
    assert keys(read(client, f"{API}/resources")["resources"]) == {"balance_1"}


def test_who_has_no_grant_sees_nothing(bench: Bench, guest: User) -> None:
    guest.grants.all().delete()
    client = signed_in(guest)
    for path in ("resources", "devices", "hosts", "runs"):
        assert read(client, f"{API}/{path}", status=403)["code"] == "http.no_role"


def test_an_id_that_a_client_sends_along_is_refused_not_obeyed(bench: Bench) -> None:
    client = signed_in(bench.people["chemist"])
    version = str(bench.version("Move 5 mL of water").id)
    for extra in ("lab", "state", "created_by", "plan"):
        answer = call(client, "POST", f"{API}/runs", {"version_id": version, extra: "x"})
        assert (answer.status_code, code_of(answer)) == (422, "http.body")
    assert not Run.objects.exists()


def test_who_has_a_role_on_a_part_is_offered_nothing_that_takes_it_on_the_whole_lab(
    bench: Bench, guest: User, client: Client
) -> None:
    a_user("observer", on=bench.node("lab"), name=guest.username)
    for role in ("approver", "admin"):
        a_user(role, on=bench.node("balance_1"), name=guest.username)
    an_edge(bench)
    (host,) = read(client, f"{API}/hosts")["hosts"]
    may = read(client, f"{API}/hosts/{host['id']}")["can"]
    assert may == {"fence": False, "readmit": False, "revoke": False}
    a_started_run(bench, HEAT)
    (asked,) = read(client, f"{API}/approvals")["requests"]
    assert asked["can_decide"] is False
    assert asked["why_not"] == "deciding needs the role approver on the whole lab"
    decision = f"{API}/approvals/{asked['id']}/decision"
    assert call(client, "POST", decision, {"is_approved": True}).status_code == 403
