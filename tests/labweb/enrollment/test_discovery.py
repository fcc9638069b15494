"""What hosts see: the inbox, the typed code, admission action by action, another key."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from django.db import connection
from django.test import Client
from pytest_django import Settings

from labweb.accounts.models import AuditEntry
from labweb.common.signatures import authority
from labweb.domain.enrollment.device_announcements import MOST_OPEN
from labweb.domain.errors import DefinitionError, EnrollmentError, ForbiddenError, StateError
from labweb.domain.messages.certificates_and_sightings import Sighting
from labweb.enrollment import selectors, services
from labweb.enrollment.models import Candidate, Device
from labweb.runs.services.planning.lab_view import lab_view
from tests.builders import Bench, Edge, an_edge, host_key, public_half
from tests.labweb.web import signed_in


@pytest.fixture(autouse=True)
def _own_authority(settings: Settings, tmp_path: Path) -> Iterator[None]:
    settings.DATA_DIR = tmp_path
    yield
    authority._load.cache_clear()


def a_sighting(**changes: str) -> Sighting:
    fields = {
        "source": "beacon",
        "address": "tcp://192.0.2.9:5000",
        "name": "Plate 2",
        "model": "RCT",
        "serial": "0815",
        "public_key": public_half(Ed25519PrivateKey.generate()),
        "driver": "IkaRctDigital",
    }
    return Sighting(**{**fields, **changes})


def seen(bench: Bench, edge: Edge, **changes: str) -> Candidate:
    before = set(Candidate.objects.values_list("pk", flat=True))
    services.take_sightings(edge.host_id, edge.epoch, [a_sighting(**changes)])
    return Candidate.objects.exclude(pk__in=before).get()


def wanted(bench: Bench, name: str = "Plate 2") -> services.WantedDevice:
    heater = bench.device("heater_1")
    return services.WantedDevice(
        name=name,
        driver_digest=heater.driver.digest,
        transport="tcp://192.0.2.9:5000",
        config=heater.config,
        nodes={"heater": bench.node("flask_2").id},
        label="RCT 0815",
    )


def taken_up(bench: Bench, row: Candidate, name: str = "Plate 2") -> Device:
    return services.take_up(
        row.id,
        wanted(bench, name),
        typed=selectors.code_of_candidate(row),
        reason="label compared",
        actor=bench.people["admin"],
    )


def test_what_a_host_sees_waits_in_the_inbox_and_adds_nothing(bench: Bench) -> None:
    edge = an_edge(bench)
    count = Device.objects.count()
    one = a_sighting()
    assert services.take_sightings(edge.host_id, edge.epoch, [one]) == 1
    assert services.take_sightings(edge.host_id, edge.epoch, [one]) == 0
    row = Candidate.objects.get()
    assert (row.state, row.seen_count, row.host_id) == ("new", 2, edge.host_id)
    assert Device.objects.count() == count
    assert services.take_sightings(edge.host_id, edge.epoch - 1, [a_sighting()]) == 0


def test_the_inbox_of_one_host_has_an_end(bench: Bench) -> None:
    edge = an_edge(bench)
    many = [
        a_sighting(serial=str(number), address=f"tcp://192.0.{number}.9:5000")
        for number in range(MOST_OPEN + 20)
    ]
    for at in range(0, len(many), 50):
        services.take_sightings(edge.host_id, edge.epoch, many[at : at + 50])
    assert Candidate.objects.count() == MOST_OPEN


def test_a_candidate_becomes_a_device_and_is_admitted_action_by_action(bench: Bench) -> None:
    edge, admin = an_edge(bench), bench.people["admin"]
    device = taken_up(bench, seen(bench, edge))
    assert (device.state, device.key, device.host_id) == ("candidate", "plate_2", edge.host_id)
    assert "plate_2" not in {one.key for one in lab_view(bench.lab).devices}
    limit = {"heat_to": {"temperature_c": 60.0}}
    services.admit_device(device.id, actor=admin, reason="heats", admission=limit)
    device = bench.device("plate_2")
    assert [action.name for action in selectors.spec_of(device).actions] == ["heat_to"]
    assert "plate_2" in {one.key for one in lab_view(bench.lab).devices}
    services.close_session(edge.host_id, edge.epoch)
    welcome = services.open_session(edge.hello("n"), "n")
    told = next(one for one in welcome.devices if one.key == "plate_2")
    assert told.admission == limit
    steps = set(AuditEntry.objects.values_list("action", flat=True))
    assert {"device.seen", "device.taken_up", "device.admit"} <= steps


@pytest.mark.parametrize(
    ("changes", "typed"),
    [
        ({}, "0000-0000-0000"),
        ({"public_key": ""}, "0816"),
        ({"public_key": "", "serial": ""}, "tcp://192.0.2.8:5000"),
    ],
)
def test_what_was_typed_wrongly_takes_nothing_up_and_is_on_record(
    bench: Bench, changes: dict[str, str], typed: str
) -> None:
    row = seen(bench, an_edge(bench), **changes)
    with pytest.raises(EnrollmentError) as refusal:
        services.take_up(
            row.id, wanted(bench), typed=typed, reason="ok", actor=bench.people["admin"]
        )
    assert refusal.value.code == "device.code_differs"
    assert AuditEntry.objects.get(action="device.code_differs").subject == str(row.id)
    assert not Device.objects.filter(key="plate_2").exists()


@pytest.mark.parametrize("role", ["observer", "chemist", "approver"])
def test_only_an_admin_answers(bench: Bench, role: str) -> None:
    row = seen(bench, an_edge(bench))
    actor = bench.people[role]
    with pytest.raises(ForbiddenError):
        services.take_up(
            row.id,
            wanted(bench),
            typed=selectors.code_of_candidate(row),
            reason="mine",
            actor=actor,
        )
    with pytest.raises(ForbiddenError):
        services.set_candidate_aside(row.id, "ignored", reason="mine", actor=actor)


def test_settings_that_do_not_fit_are_listed_and_nothing_changes(bench: Bench) -> None:
    row = seen(bench, an_edge(bench))
    wrong = services.WantedDevice(
        name="Plate 2",
        driver_digest=bench.device("pump_1").driver.digest,
        transport="tcp://192.0.2.9:5000",
        config={"nonsense": 1},
    )
    with pytest.raises(DefinitionError) as refusal:
        services.take_up(
            row.id,
            wrong,
            typed=selectors.code_of_candidate(row),
            reason="ok",
            actor=bench.people["admin"],
        )
    assert refusal.value.findings
    row.refresh_from_db()
    assert (row.state, row.device) == ("new", None)


def test_a_device_without_a_key_is_not_suspended_by_rumour(bench: Bench) -> None:
    edge, admin = an_edge(bench), bench.people["admin"]
    row = seen(bench, edge, public_key="")
    device = services.take_up(row.id, wanted(bench), typed="0815", reason="read", actor=admin)
    services.admit_device(device.id, actor=admin, reason="ok")
    seen(bench, edge)
    assert bench.device("plate_2").state == "enrolled"


def test_what_was_set_aside_stays_so_and_can_be_taken_back(bench: Bench) -> None:
    edge, admin = an_edge(bench), bench.people["admin"]
    one = a_sighting()
    services.take_sightings(edge.host_id, edge.epoch, [one])
    row = Candidate.objects.get()
    services.set_candidate_aside(row.id, "rejected", reason="not ours", actor=admin)
    services.take_sightings(edge.host_id, edge.epoch, [one])
    assert Candidate.objects.get().state == "rejected"
    with pytest.raises(StateError) as refusal:
        taken_up(bench, row)
    assert refusal.value.code == "candidate.rejected"
    services.set_candidate_aside(row.id, "new", reason="it is ours", actor=admin)
    assert taken_up(bench, row).state == "candidate"


def another(bench: Bench, key: str = "other") -> Edge:
    """Another host of the lab, with an open session."""
    row = services.add_host(
        bench.lab,
        key=key,
        name=key.capitalize(),
        host_id=uuid4(),
        public_key=public_half(host_key()),
    )
    edge = Edge(bench)
    edge.host_id = row.id
    edge.connect()
    return edge


def test_a_rejected_key_is_rejected_at_every_host_and_taken_back_at_every_host(
    bench: Bench,
) -> None:
    edge, other, admin = an_edge(bench), another(bench), bench.people["admin"]
    key = public_half(Ed25519PrivateKey.generate())
    first = seen(bench, edge, public_key=key)
    second = seen(bench, other, public_key=key)
    services.set_candidate_aside(first.id, "rejected", reason="a stranger's", actor=admin)
    second.refresh_from_db()
    assert (second.state, second.reason, second.decided_by) == ("rejected", "a stranger's", admin)
    audited = AuditEntry.objects.filter(action="device.rejected").values_list("subject", flat=True)
    assert set(audited) == {str(first.id), str(second.id)}
    services.set_candidate_aside(second.id, "new", reason="known after all", actor=admin)
    first.refresh_from_db()
    assert first.state == "new"


def test_a_rejected_key_that_another_host_sees_is_no_news_and_suspends_nothing(
    bench: Bench,
) -> None:
    edge, other, admin = an_edge(bench), another(bench), bench.people["admin"]
    device = taken_up(bench, seen(bench, edge, serial="77"))
    services.admit_device(device.id, actor=admin, reason="heats")
    key = public_half(Ed25519PrivateKey.generate())
    first = seen(bench, edge, public_key=key, serial="78")
    services.set_candidate_aside(first.id, "rejected", reason="a stranger's", actor=admin)
    second = seen(bench, other, public_key=key, serial="77")
    assert (second.state, second.reason) == ("rejected", "a stranger's")
    assert bench.device("plate_2").state == "enrolled", "a blocked key takes nothing out of service"
    assert second not in selectors.new_candidates(bench.lab)


def test_what_was_rejected_at_one_host_is_not_taken_up_at_another(bench: Bench) -> None:
    edge, other, admin = an_edge(bench), another(bench), bench.people["admin"]
    key = public_half(Ed25519PrivateKey.generate())
    first, second = (seen(bench, one, public_key=key) for one in (edge, other))
    Candidate.objects.filter(pk=first.pk).update(state="rejected")
    with pytest.raises(StateError) as refusal:
        taken_up(bench, second)
    assert refusal.value.code == "candidate.rejected"
    assert bench.host.name in refusal.value.message
    Candidate.objects.filter(pk=first.pk).update(state="new")
    taken_up(bench, second)
    with pytest.raises(StateError) as refusal:
        services.set_candidate_aside(first.id, "rejected", reason="x", actor=admin)
    assert refusal.value.code == "candidate.key_in_use"
    assert "Plate 2" in refusal.value.message


def test_the_key_of_a_device_that_was_retired_can_be_rejected(bench: Bench) -> None:
    edge, other, admin = an_edge(bench), another(bench), bench.people["admin"]
    key = public_half(Ed25519PrivateKey.generate())
    first, second = (seen(bench, one, public_key=key) for one in (edge, other))
    device = taken_up(bench, first)
    Device.objects.filter(pk=device.pk).update(state="retired")
    services.set_candidate_aside(second.id, "rejected", reason="stolen", actor=admin)
    first.refresh_from_db()
    second.refresh_from_db()
    assert (first.state, second.state) == ("taken_up", "rejected")


@pytest.mark.django_db(transaction=True)
def test_two_who_reject_a_key_at_two_hosts_wait_for_each_other(bench: Bench) -> None:
    edge, other, admin = an_edge(bench), another(bench), bench.people["admin"]
    key = public_half(Ed25519PrivateKey.generate())
    rows = [seen(bench, one, public_key=key) for one in (edge, other)]
    is_time = threading.Barrier(2)
    failures = list[Exception]()

    def reject(row: Candidate) -> None:
        try:
            for _ in range(10):
                is_time.wait(20)
                services.set_candidate_aside(row.id, "rejected", reason="no", actor=admin)
        except Exception as error:  # noqa: BLE001 - told by the test
            failures.append(error)
            is_time.abort()
        finally:
            connection.close()

    both = [threading.Thread(target=reject, args=(row,)) for row in rows]
    for one in both:
        one.start()
    for one in both:
        one.join()
    assert not failures


def form_of(bench: Bench, row: Candidate, **changes: Any) -> dict[str, Any]:  # noqa: ANN401
    wish = wanted(bench)
    return {
        "act": "take_up",
        "code": selectors.code_of_candidate(row),
        "driver": wish.driver_digest,
        "transport": wish.transport,
        "config": "{}",
        "name": "Plate 2",
        "node": str(bench.node("flask_2").id),
        "role": "heater",
        "reason": "compared",
        **changes,
    }


def test_the_page_takes_up_and_the_next_one_admits_what_is_ticked(bench: Bench) -> None:
    row = seen(bench, an_edge(bench))
    client: Client = signed_in(bench.people["admin"])
    url = f"/admin/enrollment/candidate/{row.id}/review/"
    page = client.get(url).content.decode()
    assert "0815" in page
    assert selectors.code_of_candidate(row) not in page, "it is read on the device"
    wrong = client.post(url, form_of(bench, row, code="0000"))
    assert wrong.status_code == 422
    assert "Do not admit" in wrong.content.decode()
    for bad in ({"config": "["}, {"config": "[]"}, {"node": "x"}, {"driver": ""}, {"name": "−"}):
        assert client.post(url, form_of(bench, row, **bad)).status_code == 422, bad
    answer = client.post(url, form_of(bench, row))
    device = bench.device("plate_2")
    review = f"/admin/enrollment/device/{device.id}/review/"
    assert (answer.status_code, answer["Location"]) == (302, review)
    ticked = {
        "act": "admit",
        "reason": "ok",
        "action": ["heat_to", "stir"],
        "seen": device.driver.digest,
    }
    bad_limit = client.post(review, {**ticked, "limit.heat_to.temperature_c": "hot"})
    assert bad_limit.status_code == 422
    client.post(review, {**ticked, "limit.heat_to.temperature_c": "60"})
    assert bench.device("plate_2").admission == {"heat_to": {"temperature_c": 60.0}, "stir": {}}


def test_the_page_admits_for_reading_only(bench: Bench) -> None:
    Device.objects.filter(key="ph_1").update(state="candidate")
    client = signed_in(bench.people["admin"])
    url = f"/admin/enrollment/device/{bench.device('ph_1').id}/review/"
    seen = bench.device("ph_1").driver.digest
    client.post(url, {"act": "read_only", "reason": "to begin with", "seen": seen})
    device = bench.device("ph_1")
    assert (device.state, device.admission) == ("enrolled", {})
    assert selectors.spec_of(device).actions == ()
    assert selectors.spec_of(device).statuses
