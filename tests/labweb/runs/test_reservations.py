"""Reservations: others begin nothing, the line keeps its order, and time ends them."""

from __future__ import annotations

import json
from datetime import timedelta
from typing import Any

import pytest

from labweb.crutd import services as crutd_services
from labweb.crutd.models import ResourceReservation
from labweb.domain.errors import LockedError
from labweb.runs import services
from labweb.runs.models import Run
from tests.builders import Bench, a_started_run, a_user, an_edge, dispatched
from tests.labweb.crutd.hand import node, post, pour
from tests.labweb.crutd.test_by_hand_stock import archive
from tests.labweb.web import call, read, signed_in


def asked(bench: Bench, *keys: str, role: str = "chemist", **changed: Any) -> tuple[int, Any]:  # noqa: ANN401
    """Ask for a reservation as a browser does."""
    ids = [node(bench, key) for key in keys]
    wanted = {"resource_ids": ids, "minutes": 30, "reason": "a long reflux", **changed}
    answer = call(signed_in(bench.people[role]), "POST", "/api/v1/reservations", wanted)
    return answer.status_code, json.loads(answer.content)


def made(bench: Bench, *keys: str, role: str = "chemist") -> str:
    status, told = asked(bench, *keys, role=role)
    assert status == 201, told
    return str(told["reservations"][0]["id"])


def pass_by(reservation_id: str) -> None:
    """Let the time of a reservation be over."""
    rows = ResourceReservation.objects.filter(pk=reservation_id)
    rows.update(made_at=rows.get().made_at - timedelta(hours=2))
    rows.update(expires_at=rows.get().made_at + timedelta(hours=1))


def test_others_begin_nothing_on_it_and_its_holder_does(bench: Bench) -> None:
    made(bench, "water")
    operation = pour(bench, "water", "flask_1", 1_000_000)
    status, told = post(bench, operation, role="approver")
    assert (status, told["code"]) == (423, "crutd.reserved")
    assert told["findings"][0]["subject"] == node(bench, "water")
    assert "a long reflux" in told["message"]
    assert "Chemist Person" in told["message"]
    _, looked = post(bench, operation, role="approver", at="/check")
    assert [one["code"] for one in looked["findings"]] == ["crutd.reserved"]
    assert post(bench, operation, role="chemist")[0] == 201


def test_who_may_not_see_what_is_reserved_hears_when_to_come_again(bench: Bench) -> None:
    """The flask stands on a balance that this chemist may not know of."""
    bench.people["guest"] = a_user("chemist", on=bench.node("flask_1"), name="guest")
    balance = made(bench, "balance_1")
    operation = {"op": "dispose", "resource_id": node(bench, "flask_1")}
    status, told = post(bench, operation, role="guest")
    assert (status, told["code"]) == (423, "crutd.reserved")
    stock = f"/api/v1/resources/{node(bench, 'flask_1')}/stock"
    looked = read(signed_in(bench.people["guest"]), stock)
    assert "is reserved until" in told["message"]
    assert "is reserved until" in looked["why_not"]
    for secret in ("Balance", "reflux", "Chemist Person", balance, node(bench, "balance_1")):
        assert secret not in json.dumps([told, looked])


def test_it_ends_by_itself(bench: Bench) -> None:
    pass_by(made(bench, "water"))
    operation = pour(bench, "water", "flask_1", 1_000_000)
    assert post(bench, operation, role="approver")[0] == 201
    client = signed_in(bench.people["chemist"])
    assert read(client, "/api/v1/reservations") == {"reservations": [], "next": None}


@pytest.mark.parametrize(("reserved", "used"), [("bench", "water"), ("water", "bench")])
def test_what_stands_in_it_and_what_it_stands_in_is_reserved_too(
    bench: Bench, reserved: str, used: str
) -> None:
    top = bench.node("water").parent
    assert top is not None
    keys = {"water": "water", "bench": top.key}
    made(bench, keys[reserved])
    actor = bench.people["approver"]
    run = {"water": bench.node("water").id, "bench": top.id}[used]
    assert not crutd_services.is_free([run], actor_id=actor.pk)
    assert crutd_services.is_free([run], actor_id=bench.people["chemist"].pk)


def test_whoever_asks_later_comes_after(bench: Bench) -> None:
    first = made(bench, "water", role="chemist")
    made(bench, "water", role="approver")
    operation = pour(bench, "water", "flask_1", 1_000_000)
    assert post(bench, operation, role="approver")[1]["code"] == "crutd.reserved"
    assert post(bench, operation, role="chemist")[0] == 201, "the later one is not in the way"
    ended = call(
        signed_in(bench.people["chemist"]), "POST", f"/api/v1/reservations/{first}/end", {}
    )
    assert ended.status_code == 200
    assert post(bench, operation, role="approver")[0] == 201
    assert post(bench, operation, role="chemist")[1]["code"] == "crutd.reserved"


def test_asking_again_keeps_the_place_in_the_line(bench: Bench) -> None:
    made(bench, "water", role="chemist")
    made(bench, "water", role="approver")
    made(bench, "water", role="chemist")
    operation = pour(bench, "water", "flask_1", 1_000_000)
    assert post(bench, operation, role="chemist")[0] == 201
    client = signed_in(bench.people["chemist"])
    line = read(client, f"/api/v1/resources/{node(bench, 'water')}/reservations")
    assert [one["is_own"] for one in line["reservations"]] == [True, False]


def test_a_run_of_others_is_not_started_on_it(bench: Bench) -> None:
    made(bench, "water", role="approver")
    with pytest.raises(LockedError) as refusal:
        a_started_run(bench)
    assert refusal.value.code == "crutd.reserved"
    assert not Run.objects.exists()
    assert a_started_run(bench, actor="approver").number == 1


def test_what_a_run_of_others_still_needs_is_not_reserved(bench: Bench) -> None:
    an_edge(bench)
    run = a_started_run(bench)
    dispatched(run)
    status, told = asked(bench, "water", role="approver")
    assert (status, told["code"]) == (423, "reservation.run_under_way")
    assert "run 1 of Chemist Person" in told["message"]
    assert not ResourceReservation.objects.exists()
    assert asked(bench, "water", role="chemist")[0] == 201, "it is the holder's own run"


def test_only_its_holder_and_approvers_end_it(bench: Bench) -> None:
    other = a_user("chemist", on=bench.node("water"), name="other")
    reservation = made(bench, "water")
    path = f"/api/v1/reservations/{reservation}/end"
    answer = call(signed_in(other), "POST", path, {})
    assert (answer.status_code, json.loads(answer.content)["code"]) == (
        403,
        "reservation.not_yours",
    )
    assert call(signed_in(bench.people["approver"]), "POST", path, {}).status_code == 200
    row = ResourceReservation.objects.get()
    assert row.ended_by == bench.people["approver"]
    ended_at = row.ended_at
    assert call(signed_in(bench.people["chemist"]), "POST", path, {}).status_code == 200
    assert ResourceReservation.objects.get().ended_at == ended_at, "the first end stays"


@pytest.mark.parametrize(
    ("changed", "code"),
    [
        ({"minutes": 0}, "reservation.length"),
        ({"minutes": -5}, "reservation.length"),
        ({"minutes": 24 * 60 + 1}, "reservation.length"),
        ({"minutes": 1_000_001}, "reservation.length"),
        ({"minutes": 10**30}, "http.body"),
        ({"minutes": "30"}, "http.body"),
        ({"reason": " "}, "reservation.reason"),
        ({"reason": "x" * 501}, "reservation.reason"),
        ({"resource_ids": []}, "reservation.count"),
        ({"resource_ids": ["nonsense"]}, "http.body"),
        ({"resource_ids": ["00000000-0000-0000-0000-000000000000"]}, "resource.not_found"),
        ({"until": "tomorrow"}, "http.body"),
    ],
)
def test_a_bad_request_is_refused_and_changes_nothing(
    bench: Bench, changed: dict[str, Any], code: str
) -> None:
    status, told = asked(bench, "water", **changed)
    assert (status // 100, told["code"]) == (4, code)
    if code == "reservation.length":
        assert "lasts from 1 to 1440 minutes, which is 24 hours" in told["message"]
    assert not ResourceReservation.objects.exists()


def test_an_observer_reserves_nothing(bench: Bench) -> None:
    assert asked(bench, "water", role="observer")[0] == 403


def test_what_is_in_the_archive_is_not_reserved(bench: Bench) -> None:
    bench.unplug("flask_1")
    assert post(bench, archive(bench, "flask_1"))[0] == 201
    status, told = asked(bench, "water", "flask_1")
    assert (status, told["code"]) == (412, "crutd.archived")
    assert not ResourceReservation.objects.exists(), "none of them"


def test_two_that_overlap_never_wait_for_each_other(bench: Bench) -> None:
    """One has a flask and asks for the bench; the other has the bench and asks for the flask."""
    top = bench.node("water").parent
    assert top is not None
    chemist, approver = bench.people["chemist"], bench.people["approver"]
    half_hour = timedelta(minutes=30)
    services.reserve([bench.node("water").id], actor=chemist, lasts=half_hour, reason="a")
    services.reserve([top.id], actor=approver, lasts=half_hour, reason="b")
    services.reserve([top.id], actor=chemist, lasts=half_hour, reason="c")
    free = {
        (key, who.username)
        for key, nodes in {"flask": bench.node("water").id, "top": top.id}.items()
        for who in (chemist, approver)
        if crutd_services.is_free([nodes], actor_id=who.pk)
    }
    assert free == {("flask", "chemist")}, "and the bench is the approver's when the flask is free"
