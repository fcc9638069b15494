"""A device that waits for its review is looked at first: it reads, and proves what it can."""

from __future__ import annotations

from datetime import timedelta
from typing import Any

import msgspec
import pytest

from labweb.accounts.models import AuditEntry
from labweb.common.clock import now
from labweb.common.signatures import signing
from labweb.crutd.models import Event, Transaction
from labweb.domain.enrollment.driver_bundle import decode_bundle
from labweb.domain.errors import ForbiddenError, StateError
from labweb.domain.messages.device_looks import LookOrder, LookTold
from labweb.enrollment import selectors, services
from labweb.enrollment.models import Device, EdgeHost, Look
from labweb.runs.models import Job, Outbox
from tests.builders import Bench, Edge, a_lab, an_edge
from tests.labweb.web import signed_in

VALUES = {"value_ph": 7.02, "temperature_c": 21.5}


@pytest.fixture
def found(db: None) -> Bench:
    return a_lab(discovered=["ph_1"])


@pytest.fixture
def edge(found: Bench) -> Edge:
    made = an_edge(found)
    EdgeHost.objects.filter(pk=made.host_id).update(clock_skew_s=0.02)
    return made


def ask(bench: Bench, key: str = "ph_1", person: str = "admin") -> Look:
    return services.ask_look(bench.device(key).id, actor=bench.people[person])


def tell(edge: Edge, row: Look, **fields: Any) -> None:  # noqa: ANN401 - fields of the frame
    told = {"values": VALUES, "took_s": 0.3, **fields}
    services.take_look(edge.host_id, edge.epoch, LookTold(epoch=1, look_id=row.id, **told))


def statuses(bench: Bench) -> set[str]:
    return {one.name for one in selectors.declared_spec(bench.device("ph_1")).statuses}


def test_the_host_gets_the_approved_source_with_a_signed_order_and_no_job(
    found: Bench, edge: Edge
) -> None:
    kinds = (Job, Transaction, Event, Outbox)
    before = [kind.objects.count() for kind in kinds]
    row, device = ask(found), found.device("ph_1")
    parts = services.look_frames(edge.host_id, edge.epoch, row.id)
    data = b"".join(part.data for part in parts)
    assert decode_bundle(data, device.driver.digest) == device.driver.sources
    order, approval = parts[0].order, parts[0].approval
    assert order is not None
    assert approval is not None
    for signed in (order, approval):
        text = signed.body.encode()
        assert signing.is_signed_by(signing.public_key(), text, signed.signature)
    said = msgspec.json.decode(order.body, type=LookOrder)
    assert (said.transport, said.config) == (device.transport, device.config)
    assert (said.host_id, said.epoch) == (edge.host_id, edge.epoch)
    assert services.look_frames(edge.host_id, edge.epoch + 1, row.id) == []
    assert [kind.objects.count() for kind in kinds] == before
    assert AuditEntry.objects.get(subject=str(row.id)).action == "device.look"


def test_what_it_told_stands_in_the_review_and_the_admission_names_it(
    found: Bench, edge: Edge
) -> None:
    assert statuses(found) == set(VALUES)
    client, device = signed_in(found.people["admin"]), found.device("ph_1")
    url = f"/admin/enrollment/device/{device.id}/review/"
    assert client.post(url, {"act": "look", "seen": device.driver.digest}).status_code == 302
    page = client.get(url)
    assert page["Refresh"] == "2"
    assert "looks at it" in page.content.decode()
    row = Look.objects.get()
    tell(edge, row)
    page = client.get(url)
    assert "Refresh" not in page
    text = page.content.decode()
    assert "7.02" in text
    assert "passed</span>" in text
    assert "not passed" not in text
    reason = "the display shows the same"
    client.post(url, {"act": "admit", "reason": reason, "seen": row.driver.digest})
    detail = AuditEntry.objects.get(action="device.admit").detail
    assert detail["look"] == {"id": str(row.id), "failed": []}


def test_a_look_that_fails_says_why_and_changes_nothing(found: Bench, edge: Edge) -> None:
    row = ask(found)
    tell(edge, row, code="device.no_answer", message="nobody answers", values={})
    client, device = signed_in(found.people["admin"]), found.device("ph_1")
    text = client.get(f"/admin/enrollment/device/{device.id}/review/").content.decode()
    assert "not passed" in text
    assert "nobody answers" in text
    assert device.state == "candidate"


def test_a_look_at_what_it_was_before_proves_nothing_of_what_it_is_now(
    found: Bench, edge: Edge
) -> None:
    tell(edge, ask(found))
    assert selectors.last_look(found.device("ph_1")) is not None
    Device.objects.filter(key="ph_1").update(transport="tcp://192.0.2.7:5000")
    assert selectors.last_look(found.device("ph_1")) is None


def test_only_the_host_and_session_that_was_asked_answers_and_once(
    found: Bench, edge: Edge
) -> None:
    row = ask(found)
    told = LookTold(epoch=1, look_id=row.id, values={"value_ph": 3.0})
    services.take_look(edge.host_id, edge.epoch + 1, told)
    row.refresh_from_db()
    assert row.told == {}
    tell(edge, row)
    services.take_look(edge.host_id, edge.epoch, told)
    row.refresh_from_db()
    assert row.told["values"] == VALUES


def test_an_answer_without_end_is_not_kept(found: Bench, edge: Edge) -> None:
    row = ask(found)
    tell(edge, row, values={"value_ph": "7" * 40_000})
    row.refresh_from_db()
    assert (row.told["code"], row.told["values"]) == ("look.too_long", {})


def test_who_may_not_admit_looks_at_nothing(found: Bench, edge: Edge) -> None:
    assert edge.epoch
    for person in ("observer", "chemist", "approver"):
        with pytest.raises(ForbiddenError):
            ask(found, person=person)
    assert not Look.objects.exists()


def test_a_device_that_is_served_or_out_of_reach_is_not_looked_at(found: Bench, edge: Edge) -> None:
    with pytest.raises(StateError) as served:
        ask(found, "heater_1")
    row = ask(found)
    with pytest.raises(StateError) as twice:
        ask(found)
    Look.objects.filter(pk=row.pk).update(asked_at=now() - timedelta(seconds=200))
    EdgeHost.objects.filter(pk=edge.host_id).update(state="isolated")
    with pytest.raises(StateError) as away:
        ask(found)
    codes = [one.value.code for one in (served, twice, away)]
    assert codes == ["look.served", "look.under_way", "look.no_host"]
    assert Look.objects.count() == 1


def test_what_was_lost_may_be_asked_again(found: Bench, edge: Edge) -> None:
    assert edge.epoch
    row = ask(found)
    Look.objects.filter(pk=row.pk).update(asked_at=now() - timedelta(seconds=200))
    again = ask(found)
    assert again.id != row.id
    edge.connect()
    assert ask(found).id != again.id, "its session is over"
