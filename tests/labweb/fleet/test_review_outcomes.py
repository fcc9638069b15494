"""The outcomes that the review of a device offers, and what each of them does."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from pytest_django import Settings

from labweb.accounts.models import AuditEntry
from labweb.common.signatures import authority
from labweb.crutd import services as crutd_services
from labweb.domain.crutd.operations import TransferLiquid
from labweb.enrollment import services
from labweb.enrollment.models import Candidate, Device
from tests.builders import Bench, an_edge
from tests.labweb.crutd.test_adopting import adopted
from tests.labweb.enrollment.test_discovery import seen, taken_up
from tests.labweb.web import read, signed_in

ACTS = ("admit", "read_only", "suspend", "quarantine", "ignore", "reject", "retire")


@pytest.fixture(autouse=True)
def _own_authority(settings: Settings, tmp_path: Path) -> Iterator[None]:
    settings.DATA_DIR = tmp_path
    yield
    authority._load.cache_clear()


def url_of(device: Device) -> str:
    return f"/admin/enrollment/device/{device.id}/review/"


def offered(bench: Bench, device: Device) -> set[str]:
    page = signed_in(bench.people["admin"]).get(url_of(device)).content.decode()
    return {act for act in ACTS if f'value="{act}"' in page}


def test_the_page_offers_what_may_become_of_a_device(bench: Bench) -> None:
    admin = bench.people["admin"]
    device = taken_up(bench, seen(bench, an_edge(bench)))
    assert offered(bench, device) == {"admit", "read_only", "quarantine", "ignore", "reject"}
    services.admit_device(device.id, actor=admin, reason="seen")
    assert offered(bench, device) == {"suspend", "retire"}
    services.suspend_device(device.id, actor=admin, reason="drifts")
    assert offered(bench, device) == {"admit", "read_only", "retire"}


def test_what_no_host_saw_is_retired_alone(bench: Bench) -> None:
    Device.objects.filter(key="timer_1").update(state="candidate")
    assert offered(bench, bench.device("timer_1")) == {"admit", "read_only", "retire"}


@pytest.mark.parametrize(
    ("act", "state"),
    [("quarantine", "quarantined"), ("ignore", "ignored"), ("reject", "rejected")],
)
def test_an_outcome_ends_the_device_and_answers_what_was_seen(
    bench: Bench, act: str, state: str
) -> None:
    row = seen(bench, an_edge(bench))
    device = adopted(bench, row)
    client = signed_in(bench.people["admin"])
    without = client.post(url_of(device), {"act": act, "reason": " "})
    assert without.status_code == 422
    assert "the reason is empty" in without.content.decode()
    answer = client.post(url_of(device), {"act": act, "reason": "another code"}, follow=True)
    page = answer.content.decode()
    assert "Pump 9 is retired" in page
    assert f">{state}</a>" in page
    assert "Compared</span>" not in page, "the answer that ended it compared nothing"
    assert offered(bench, device) == set()
    row.refresh_from_db()
    assert (row.state, row.reason, row.decided_by) == (state, "another code", bench.people["admin"])
    assert AuditEntry.objects.get(action="device.retire").reason == "another code"
    assert bench.node("pump_9").is_archived
    inbox = client.get(f"/admin/enrollment/candidate/{row.id}/review/").content.decode()
    assert "which is retired" in inbox
    assert url_of(device) in inbox
    assert 'value="take_back"' in inbox
    again = client.post(url_of(device), {"act": "retire", "reason": "twice"})
    assert again.status_code == 422
    assert "retired already" in again.content.decode()


def test_what_speaks_against_it_stands_on_the_page(bench: Bench) -> None:
    device = adopted(bench, seen(bench, an_edge(bench)))
    move = TransferLiquid(
        source_id=bench.node("water").id, target_id=bench.node("pump_9").id, amount_nl=1_000_000
    )
    crutd_services.carry_out(move, lab=bench.lab, actor_id=bench.people["admin"].pk)
    client = signed_in(bench.people["admin"])
    answer = client.post(url_of(device), {"act": "reject", "reason": "another code"})
    assert answer.status_code == 422
    assert "cannot be retired yet: Pump 9 is to go and holds" in answer.content.decode()
    assert Candidate.objects.get().state == "taken_up"
    assert bench.device("pump_9").state == "candidate"


@pytest.mark.parametrize("act", ["quarantine", "ignore", "reject", "retire"])
@pytest.mark.parametrize("role", ["observer", "chemist", "approver"])
def test_only_who_admits_decides(bench: Bench, role: str, act: str) -> None:
    device = taken_up(bench, seen(bench, an_edge(bench)))
    client = signed_in(bench.people[role])
    assert client.post(url_of(device), {"act": act, "reason": "mine"}).status_code == 403
    assert bench.device("plate_2").state == "candidate"


def test_a_retired_device_is_listed_no_more_and_its_page_stays(bench: Bench) -> None:
    client = signed_in(bench.people["admin"])
    Device.objects.filter(key="timer_1").update(nodes={})
    timer = bench.device("timer_1")
    client.post(url_of(timer), {"act": "retire", "reason": "sold"})
    listed = read(client, "/api/v1/devices")["devices"]
    assert "timer_1" not in {one["key"] for one in listed}
    assert "heater_1" in {one["key"] for one in listed}
    assert client.get(f"/api/v1/devices/{timer.id}").status_code == 200


def test_the_inbox_tells_of_each_what_became_of_it(bench: Bench) -> None:
    edge, client = an_edge(bench), signed_in(bench.people["admin"])
    known = seen(bench, edge)
    device = taken_up(bench, known)
    claims = seen(bench, edge)
    taken_up(bench, claims)

    def page(row: Candidate) -> str:
        return client.get(f"/admin/enrollment/candidate/{row.id}/review/").content.decode()

    assert "another was taken up in its place" in page(known)
    assert url_of(device) in page(claims)
    client.post(url_of(device), {"act": "reject", "reason": "another code"})
    assert 'value="take_up"' in page(known)
    assert "which is retired" in page(claims)
