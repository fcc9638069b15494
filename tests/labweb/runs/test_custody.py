"""A vessel goes from one host's hands into another's, and never into both."""

from __future__ import annotations

import json
from typing import Any
from uuid import uuid4

import pytest
from django.http import HttpResponse

from labweb.crutd.models import Event, ResourceLock, Ticket
from labweb.domain.errors import DefinitionError, LockedError, PreconditionError, StateError
from labweb.domain.graph.attachments import LOOSE
from labweb.domain.graph.ports_and_connections import Medium
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.models import EdgeHost
from labweb.resources.models import Connection, Resource
from labweb.runs import services
from labweb.runs.models import Custody, Outbox
from tests.builders import Bench, Edge, host_key, public_half
from tests.labweb.crutd.hand import a_jar, node, post, refused
from tests.labweb.web import call, code_of, signed_in


class Second(Edge):
    """The messages of the other host."""

    def __init__(self, bench: Bench, host: EdgeHost) -> None:
        super().__init__(bench)
        self.host_id = host.id


@pytest.fixture
def flask(bench: Bench) -> Resource:
    return bench.unplug("flask_1")


@pytest.fixture
def place(bench: Bench) -> Resource:
    """A place that belongs to a second host, by the device that stands there."""
    other = enrollment_services.add_host(
        bench.lab,
        key="bench_9",
        name="bench 9",
        host_id=uuid4(),
        public_key=public_half(host_key()),
    )
    room = bench.node("lab")
    spot = Resource.objects.create(
        id=uuid4(), lab=bench.lab, key="bench_9", name="Bench 9", kind="bench", parent=room
    )
    known = bench.device("pump_1")
    enrollment_services.found_device(
        bench.lab,
        uuid4(),
        driver=known.driver,
        key="stand",
        name="stand",
        host_id=other.id,
        transport="virtual:stand",
        config={},
        nodes={"place": str(spot.id)},
        state="enrolled",
    )
    return spot


@pytest.fixture
def hosts(bench: Bench, place: Resource, flask: Resource) -> tuple[Edge, Edge]:
    known = bench.device("pump_1")
    known.nodes = {**known.nodes, "flask": str(flask.id)}
    known.save()
    first, second = Edge(bench), Second(bench, EdgeHost.objects.get(key="bench_9"))
    first.connect()
    second.connect()
    return first, second


def asked(bench: Bench, flask: Resource, place: Resource) -> Custody:
    return services.hand_over(
        flask.id, place.id, actor=bench.people["chemist"], note="to the other bench"
    )


def release(made: Custody, host: Edge) -> None:
    assert made.transfer_id is not None
    row = Outbox.objects.get(kind="release", action_id=made.transfer_id)
    body = {"transfer_id": str(made.transfer_id), "resource_id": str(made.resource_id)}
    host.report("released", None, **body, view=row.body["view"])


def receive(made: Custody, host: Edge) -> None:
    assert made.transfer_id is not None
    row = Outbox.objects.get(kind="receive", action_id=made.transfer_id)
    body = {"transfer_id": str(made.transfer_id), "resource_id": str(made.resource_id)}
    host.report("received", None, **body, rev=row.body["view"]["rev"] + 1)


def test_a_vessel_is_released_then_found_then_received(
    bench: Bench, flask: Resource, place: Resource, hosts: tuple[Edge, Edge]
) -> None:
    first, second = hosts
    made = asked(bench, flask, place)
    assert bench.node("flask_1").parent_id == flask.parent_id
    with pytest.raises(StateError) as early:
        services.confirm_arrival(made.id, actor=bench.people["chemist"])
    assert early.value.code == "custody.not_in_transit"
    release(made, first)
    made.refresh_from_db()
    assert (made.state, made.owner_id) == ("in_transit", None)
    with pytest.raises(LockedError):
        asked(bench, flask, place)
    services.confirm_arrival(made.id, actor=bench.people["chemist"])
    receive(made, second)
    made.refresh_from_db()
    assert (made.state, made.owner_id) == ("owned", second.host_id)
    after = bench.node("flask_1")
    assert after.parent_id == place.id
    assert after.rev > flask.rev
    assert not ResourceLock.objects.filter(released_at__isnull=True).exists()
    assert not Outbox.objects.filter(settled_at__isnull=True).exists()


@pytest.mark.parametrize("view", [{"id": "no id"}, None])
def test_a_vessel_of_which_its_host_speaks_no_sense_is_closed_and_the_host_goes_on(
    bench: Bench,
    flask: Resource,
    place: Resource,
    hosts: tuple[Edge, Edge],
    view: dict[str, str] | None,
) -> None:
    made = asked(bench, flask, place)
    body = {"transfer_id": str(made.transfer_id), "resource_id": str(flask.id)}
    assert hosts[0].report("released", None, **body, view=view) == 1
    assert Ticket.objects.get().code == "custody.conflict"
    assert bench.node("flask_1").quarantined_by is not None
    assert bench.host.state == "online"


def test_what_its_host_keeps_stays_where_it_is(
    bench: Bench, flask: Resource, place: Resource, hosts: tuple[Edge, Edge]
) -> None:
    made = asked(bench, flask, place)
    body = {"transfer_id": str(made.transfer_id), "resource_id": str(flask.id)}
    hosts[0].report("kept", None, **body, code="custody.in_use")
    made.refresh_from_db()
    assert (made.state, made.owner_id) == ("owned", hosts[0].host_id)
    assert bench.node("flask_1").parent_id == flask.parent_id
    assert not ResourceLock.objects.filter(released_at__isnull=True).exists()


def test_a_move_survives_a_reconnect_of_either_host(
    bench: Bench, flask: Resource, place: Resource, hosts: tuple[Edge, Edge]
) -> None:
    first, second = hosts
    made = asked(bench, flask, place)
    first.connect()
    assert services.publish_outbox() == 1
    release(made, first)
    services.confirm_arrival(made.id, actor=bench.people["chemist"])
    second.connect()
    receive(made, second)
    made.refresh_from_db()
    assert made.owner_id == second.host_id


def test_a_host_that_receives_what_was_not_sent_to_it_opens_a_ticket(
    bench: Bench, flask: Resource, place: Resource, hosts: tuple[Edge, Edge]
) -> None:
    second = hosts[1]
    made = asked(bench, flask, place)
    body = {"transfer_id": str(made.transfer_id), "resource_id": str(flask.id)}
    assert second.report("received", None, **body, rev=9) is not None
    assert Ticket.objects.get().code == "custody.conflict"
    assert bench.node("flask_1").quarantined_by is not None
    assert EdgeHost.objects.get(pk=second.host_id).state == "online", "its log is sound"


def test_a_host_that_is_lost_with_a_vessel_on_its_way_closes_the_vessel(
    bench: Bench, flask: Resource, place: Resource, hosts: tuple[Edge, Edge]
) -> None:
    made = asked(bench, flask, place)
    hosts[0].send(hosts[0].event("boot", None))
    hosts[0].event("boot", None)
    assert hosts[0].send(hosts[0].event("boot", None)) is None, "a gap"
    made.refresh_from_db()
    assert made.ended_at is not None
    assert bench.node("flask_1").quarantined_by is not None
    assert Ticket.objects.filter(code="custody.conflict").count() == 1


def test_a_move_within_one_host_needs_no_hand_over(
    bench: Bench, flask: Resource, hosts: tuple[Edge, Edge]
) -> None:
    with pytest.raises(DefinitionError) as refusal:
        asked(bench, flask, bench.node("flask_2"))
    assert refusal.value.code == "custody.same_host"


# --- over REST, as a person does it ---


def carried(
    bench: Bench, flask: Resource, to: Resource, *, who: str = "chemist", note: str = "for the oven"
) -> HttpResponse:
    operation = {
        "op": "transfer_resource",
        "resource_id": str(flask.id),
        "from_id": str(flask.parent_id),
        "to_id": str(to.id),
    }
    body = {"operation": operation, "note": note}
    return call(signed_in(bench.people[who]), "POST", "/api/v1/operations", body)


def hands(bench: Bench, flask: Resource, who: str = "chemist") -> dict[str, Any]:
    path = f"/api/v1/resources/{flask.id}/custody"
    found: dict[str, Any] = signed_in(bench.people[who]).get(path).json()
    return found


def test_a_place_without_room_says_what_stands_there(bench: Bench, flask: Resource) -> None:
    balance, loose = bench.node("balance_1"), bench.unplug("flask_2")
    room = {one["id"]: one["why_not"] for one in hands(bench, loose)["places"]}
    assert "it takes one thing at a time, and Flask 1 stands there" in room[str(balance.id)]
    assert str(bench.node("pump_1").id) not in room, "a pump carries nothing"
    answer = carried(bench, loose, balance)
    assert code_of(answer) == "place.occupied", "what is offered is what is taken"
    own = {one["id"]: one["why_not"] for one in hands(bench, flask)["places"]}
    assert own[str(balance.id)] is None, "nothing is in its own way"


def test_a_transfer_between_two_hosts_goes_through_the_hands_of_nobody(
    bench: Bench, flask: Resource, place: Resource, hosts: tuple[Edge, Edge]
) -> None:
    before = hands(bench, flask)
    assert (before["host"]["name"], before["move"]) == ("Host 1", None)
    assert {"id": str(place.id), "why_not": None} in before["places"]
    answer = carried(bench, flask, place)
    assert answer.status_code == 202, answer.content
    assert json.loads(answer.content)["handover"]["state"] == "leaving"
    assert bench.node("flask_1").parent_id == flask.parent_id, "nothing moves before its host says"
    made = Custody.objects.get()
    move = hands(bench, flask)["move"]
    assert (move["state"], move["from"]["name"], move["to"]["name"]) == (
        "leaving",
        "Host 1",
        "bench 9",
    )
    assert (move["released_at"], move["is_told"]) == (None, False)
    release(made, hosts[0])
    move = hands(bench, flask)["move"]
    assert (move["state"], move["from"]["name"]) == ("in_transit", "Host 1")
    assert move["released_at"] >= move["asked_at"]
    arrived = f"/api/v1/handovers/{made.id}/arrived"
    assert call(signed_in(bench.people["observer"]), "POST", arrived, {}).status_code == 403
    assert call(signed_in(bench.people["chemist"]), "POST", arrived, {}).status_code == 200
    assert hands(bench, flask)["move"]["is_told"] is True
    receive(made, hosts[1])
    after = hands(bench, flask)
    assert (after["host"]["name"], after["move"]) == ("bench 9", None)
    assert bench.node("flask_1").parent_id == place.id


@pytest.mark.parametrize(
    ("who", "note", "status", "code"),
    [
        ("observer", "for the oven", 403, "governance.forbidden"),
        ("chemist", " ", 422, "run.note_missing"),
    ],
)
def test_a_transfer_between_two_hosts_is_refused_and_changes_nothing(
    bench: Bench,
    flask: Resource,
    place: Resource,
    hosts: tuple[Edge, Edge],
    who: str,
    note: str,
    status: int,
    code: str,
) -> None:
    answer = carried(bench, flask, place, who=who, note=note)
    assert (answer.status_code, json.loads(answer.content)["code"]) == (status, code)
    assert not Custody.objects.exists()
    assert not ResourceLock.objects.filter(released_at__isnull=True).exists()
    assert not Outbox.objects.exists()
    assert hands(bench, flask, "observer")["is_allowed"] is False


def test_a_vessel_that_does_not_stand_there_is_not_asked_for(
    bench: Bench, flask: Resource, place: Resource, hosts: tuple[Edge, Edge]
) -> None:
    flask.parent_id = place.id
    answer = carried(bench, flask, place)
    assert json.loads(answer.content)["code"] == "crutd.not_there"
    assert not Custody.objects.exists()


def test_a_transfer_within_one_host_or_to_a_place_of_nobody_is_written_at_once(
    bench: Bench, flask: Resource, hosts: tuple[Edge, Edge]
) -> None:
    shelf = Resource.objects.create(
        id=uuid4(), lab=bench.lab, key="shelf", name="Shelf", kind="bench", parent=bench.node("lab")
    )
    assert carried(bench, flask, shelf).status_code == 201
    assert bench.node("flask_1").parent_id == shelf.id
    assert not Custody.objects.exists()


def test_a_vessel_of_a_host_that_was_declared_lost_is_carried_without_asking_it(
    bench: Bench, flask: Resource, place: Resource, hosts: tuple[Edge, Edge]
) -> None:
    EdgeHost.objects.filter(pk=hosts[0].host_id).update(state="fenced")
    assert carried(bench, flask, place).status_code == 201
    assert bench.node("flask_1").parent_id == place.id


def test_what_stands_in_a_vessel_goes_along_as_its_host_knows_it(
    bench: Bench, flask: Resource, place: Resource, hosts: tuple[Edge, Edge]
) -> None:
    bar = Resource.objects.create(
        id=uuid4(), lab=bench.lab, key="bar", name="Stir bar", kind="vial", parent=flask
    )
    assert carried(bench, flask, place).status_code == 202
    made = Custody.objects.get()
    row = Outbox.objects.get(kind="release")
    (part,) = row.body["parts"]
    assert part["id"] == str(bar.id)
    body = {"transfer_id": str(made.transfer_id), "resource_id": str(flask.id)}
    newer = {**part, "rev": part["rev"] + 3}
    hosts[0].report("released", None, **body, view=row.body["view"], parts=[newer])
    services.confirm_arrival(made.id, actor=bench.people["chemist"])
    assert Outbox.objects.get(kind="receive").body["parts"] == [newer]
    receive(made, hosts[1])
    assert bench.node("bar").parent_id == flask.id
    assert Event.objects.filter(name="transfer").count() == 1


# --- what is connected is not carried ---


def plug(bench: Bench, key: str, medium: str) -> Connection:
    return Connection.objects.create(
        lab=bench.lab,
        key=f"{key}_{medium}",
        source=bench.node(key),
        source_port="a",
        target=bench.node("bench_1"),
        target_port="b",
        medium=medium,
    )


def away(bench: Bench, key: str) -> dict[str, Any]:
    ends = {"from_id": str(bench.node(key).parent_id), "to_id": node(bench, "lab")}
    return {"op": "transfer_resource", "resource_id": node(bench, key), **ends}


@pytest.mark.parametrize("medium", sorted(set(Medium) - LOOSE))
def test_a_vessel_that_is_connected_is_not_carried(bench: Bench, medium: str) -> None:
    a_jar(bench, "jar")
    plug(bench, "jar", medium)
    told = refused(bench, away(bench, "jar"), "crutd.connected")
    (finding,) = told["findings"]
    assert f"jar_{medium} ({medium})" in finding["message"]
    (named,) = finding["context"]["connections"]
    assert (named["port"], named["other_id"]) == ("a", node(bench, "bench_1"))
    (shown,) = hands(bench, bench.node("jar"))["connections"]
    assert shown == {"key": f"jar_{medium}", "medium": medium, "to": "Bench 1"}


@pytest.mark.parametrize("medium", sorted(LOOSE))
def test_a_vessel_that_only_stands_there_is_carried(bench: Bench, medium: str) -> None:
    a_jar(bench, "jar")
    plug(bench, "jar", medium)
    assert hands(bench, bench.node("jar"))["connections"] == []
    assert post(bench, away(bench, "jar"))[0] == 201


def test_what_holds_a_part_holds_the_whole_but_a_link_inside_of_it_does_not(bench: Bench) -> None:
    flask = bench.unplug("flask_1")
    a_jar(bench, "jar")
    Resource.objects.filter(key="jar").update(parent=flask)
    inside = plug(bench, "jar", "liquid")
    assert refused(bench, away(bench, "flask_1"), "crutd.connected")
    Connection.objects.filter(pk=inside.pk).update(target=flask)
    assert post(bench, away(bench, "flask_1"))[0] == 201


def test_a_vessel_with_tubes_on_it_is_not_handed_over(
    bench: Bench, place: Resource, flask: Resource, hosts: tuple[Edge, Edge]
) -> None:
    plug(bench, "flask_1", "gas")
    with pytest.raises(PreconditionError) as refusal:
        asked(bench, flask, place)
    assert refusal.value.code == "crutd.connected"
    assert not Custody.objects.exists()
    assert not Outbox.objects.exists()
