"""What nobody knows any more leads to where a person settles it: Home, stock, tickets."""

from __future__ import annotations

import json
from typing import Any
from uuid import uuid4

import pytest

from labweb.accounts.models import AuditEntry
from labweb.crutd import services
from labweb.crutd.models import Event, Holding, Ticket
from labweb.domain.crutd import operations
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.resources.models import Resource
from labweb.runs import services as run_services
from labweb.runs.selectors import lab_summary
from tests.builders import Bench, a_started_run, a_user, an_edge, to_transfer
from tests.labweb.crutd.hand import done, node, post, refused
from tests.labweb.web import call, read, signed_in

API = "/api/v1"


def nobody_can_tell(bench: Bench) -> list[Resource]:
    """Lose a transfer and answer that nobody knows; return what stays quarantined."""
    edge = an_edge(bench)
    attempt = to_transfer(a_started_run(bench), edge)
    edge.lose(attempt)
    assert needs(bench, "quarantined") == [], "a doubt is answered first"
    run_services.resolve_job(
        attempt.job_id, actor=bench.people["chemist"], answer="discard", moved_nl=None, note="?"
    )
    edge.resolve(attempt)
    closed = list(Resource.objects.filter(quarantined_by=attempt.transaction_id))
    assert len(closed) == 2
    return closed


def needs(bench: Bench, kind: str, role: str = "chemist") -> list[dict[str, Any]]:
    told = read(signed_in(bench.people[role]), f"{API}/home")["needs_you"]
    return [need for need in told if need["kind"] == kind]


def take_stock(bench: Bench, row: Resource, **measured_nl: int) -> None:
    lots = {str(h.lot_id): h.amount_nl for h in Holding.objects.filter(resource=row)}
    plain = {"op": "correct", "resource_id": str(row.id), "account": "SUSPENSE", "reason": "seen"}
    done(bench, plain | {"measured_nl": lots | measured_nl})


def close(bench: Bench, ticket: Ticket, reason: str, role: str = "chemist") -> tuple[int, Any]:
    client = signed_in(bench.people[role])
    answer = call(client, "POST", f"{API}/tickets/{ticket.id}/close", {"reason": reason})
    return answer.status_code, json.loads(answer.content)


# --- what nobody knows ---


def test_what_was_given_up_needs_somebody_until_stock_was_taken(bench: Bench) -> None:
    closed = nobody_can_tell(bench)
    told = needs(bench, "quarantined")
    assert {need["title"] for need in told} == {f"Nobody knows what {r.name} holds" for r in closed}
    assert {need["url"] for need in told} == {f"/lab?sel={row.id}&stock=1" for row in closed}
    assert {need["verb"] for need in told} == {"Take stock"}
    before = lab_summary(bench.lab).counts.needs_you
    for row in closed:
        take_stock(bench, row)
    assert needs(bench, "quarantined") == []
    assert lab_summary(bench.lab).counts.needs_you == before - 2


def test_taking_stock_stands_among_the_events_of_the_vessel(bench: Bench) -> None:
    row = nobody_can_tell(bench)[0]
    take_stock(bench, row)
    told = read(signed_in(bench.people["chemist"]), f"{API}/resources/{row.id}")
    assert not told["is_quarantined"]
    assert told["events"][0]["operation"] == "update"
    assert told["events"][0]["summary"].endswith("SUSPENSE: seen")


def test_a_syringe_is_set_to_empty_by_taking_stock(bench: Bench) -> None:
    syringe = next(row for row in nobody_can_tell(bench) if row.kind == "syringe_pump")
    plain = {"op": "correct", "resource_id": str(syringe.id), "account": "SUSPENSE"}
    done(bench, plain | {"reason": "took it out by hand"})
    assert not Holding.objects.filter(resource=syringe, amount_nl__gt=0).exists()
    assert Resource.objects.get(pk=syringe.pk).quarantined_by is None


def quarantine_heater(bench: Bench) -> Resource:
    """Give up an update of a thing that holds nothing."""
    heater = bench.node("heater_1")
    row = services.lock_operation(
        operations.Update(resource_id=heater.id, data={"is_on": True}),
        lab=bench.lab,
        targets=(),
        actor_id=None,
    )
    services.settle(row.id, services.Settlement(outcome=Outcome(kind=OutcomeKind.UNKNOWN)))
    services.discard(row.id, services.Settlement(outcome=Outcome(kind=OutcomeKind.UNKNOWN)))
    return Resource.objects.get(pk=heater.pk)


def test_a_thing_that_holds_nothing_is_freed_by_a_person_who_looked(bench: Bench) -> None:
    heater = quarantine_heater(bench)
    assert needs(bench, "quarantined")[0]["title"] == f"Nobody knows what became of {heater.name}"
    lot = str(Holding.objects.filter(resource=bench.node("water")).get().lot_id)
    look = {"op": "correct", "resource_id": str(heater.id), "account": "SUSPENSE", "reason": "off"}
    refused(bench, look | {"measured_nl": {lot: 1}}, "crutd.no_vessel")
    done(bench, look)
    assert needs(bench, "quarantined") == []
    refused(bench, look, "crutd.no_vessel")


def test_who_sees_only_a_part_hears_of_nothing_outside(bench: Bench) -> None:
    nobody_can_tell(bench)
    services.open_ticket(bench.lab, "host.gap", "a gap", {"host_id": str(uuid4())})
    bench.people["guest"] = a_user("chemist", on=bench.node("balance_1"), name="guest")
    assert needs(bench, "quarantined", "guest") == needs(bench, "ticket", "guest") == []
    status, told = close(bench, Ticket.objects.get(), "mine", "guest")
    assert (status, told["code"]) == (404, "ticket.not_found")


# --- what is asked before stock is taken ---


def test_before_taking_stock_the_lots_are_listed_in_their_unit(bench: Bench) -> None:
    path = f"{API}/resources/{node(bench, 'water')}/stock"
    told = read(signed_in(bench.people["chemist"]), path)
    assert (told["is_allowed"], told["why_not"]) == (True, None)
    units = {lot["unit"] for lot in told["lots"] if lot["material"] == "Water"}
    assert units == {"nl"}


def test_who_may_not_take_stock_is_told_why(bench: Bench) -> None:
    path = f"{API}/resources/{node(bench, 'water')}/stock"
    told = read(signed_in(bench.people["observer"]), path)
    assert not told["is_allowed"]
    assert "right to resolve" in told["why_not"]


def test_no_stock_is_taken_while_an_action_is_in_doubt(bench: Bench) -> None:
    edge = an_edge(bench)
    attempt = to_transfer(a_started_run(bench), edge)
    edge.lose(attempt)
    path = f"{API}/resources/{attempt.job.operation['source_id']}/stock"
    told = read(signed_in(bench.people["chemist"]), path)
    assert not told["is_allowed"]
    assert "in use" in told["why_not"]


# --- tickets ---


def a_ticket(bench: Bench) -> Ticket:
    """Have edge and server read one fact differently."""
    edge = an_edge(bench)
    attempt = to_transfer(a_started_run(bench), edge)
    edge.act(attempt)
    body = edge.settled(attempt, Outcome(kind=OutcomeKind.DONE))
    body["change"]["postings"][0]["amount_nl"] -= 1
    edge.report("complete", attempt.id, **body)
    return Ticket.objects.get()


def test_a_ticket_is_read_where_home_leads(bench: Bench) -> None:
    ticket = a_ticket(bench)
    assert [need["url"] for need in needs(bench, "ticket")] == [f"/lab?ticket={ticket.id}"]
    told = read(signed_in(bench.people["chemist"]), f"{API}/tickets/{ticket.id}")
    assert (told["code"], told["message"]) == (ticket.code, ticket.message)
    assert told["detail"]["edge"] != told["detail"]["server"]
    assert len(told["resources"]) == 2
    assert all(row["is_quarantined"] for row in told["resources"])
    assert told["can_close"]


def test_a_ticket_is_closed_once_with_a_reason_that_is_kept(bench: Bench) -> None:
    ticket = a_ticket(bench)
    before = lab_summary(bench.lab).counts.needs_you
    status, told = close(bench, ticket, "weighed both")
    assert (status, told["closed_by"]) == (200, bench.people["chemist"].printed_name)
    assert not told["can_close"]
    assert needs(bench, "ticket") == []
    assert lab_summary(bench.lab).counts.needs_you == before - 1
    entry = AuditEntry.objects.get(action="ticket.close", subject=str(ticket.id))
    assert (entry.actor, entry.reason) == (bench.people["chemist"], "weighed both")
    status, told = close(bench, ticket, "again")
    assert (status, told["code"]) == (409, "ticket.closed")
    assert AuditEntry.objects.filter(action="ticket.close").count() == 1


def test_closing_a_ticket_ends_no_quarantine(bench: Bench) -> None:
    ticket = a_ticket(bench)
    events = Event.objects.count()
    close(bench, ticket, "weighed both")
    assert len(needs(bench, "quarantined")) == 2
    assert Event.objects.count() == events


@pytest.mark.parametrize(
    ("role", "reason", "status", "code"),
    [
        ("observer", "looked", 403, "governance.forbidden"),
        ("chemist", " ", 422, "ticket.reason_missing"),
    ],
)
def test_a_ticket_stays_open_without_right_or_reason(
    bench: Bench, role: str, reason: str, status: int, code: str
) -> None:
    ticket = a_ticket(bench)
    told = close(bench, ticket, reason, role)
    assert (told[0], told[1]["code"]) == (status, code)
    assert Ticket.objects.get().closed_at is None
    assert not AuditEntry.objects.filter(action="ticket.close").exists()


def test_a_ticket_of_no_id_is_not_found(bench: Bench) -> None:
    told = read(signed_in(bench.people["chemist"]), f"{API}/tickets/{uuid4()}", 404)
    assert told["code"] == "ticket.not_found"


def test_an_operation_is_refused_to_who_takes_no_stock(bench: Bench) -> None:
    row = nobody_can_tell(bench)[0]
    look = {"op": "correct", "resource_id": str(row.id), "account": "LOSS", "reason": "seen"}
    assert post(bench, look, role="observer")[0] == 403
    assert Resource.objects.get(pk=row.pk).quarantined_by is not None
