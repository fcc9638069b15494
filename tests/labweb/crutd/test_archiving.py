"""The Archive takes what is empty and loose, and gives it back to where it stood."""

from __future__ import annotations

import json
from typing import Any

import pytest
from django.db.models import Q

from labweb.crutd import services as crutd_services
from labweb.crutd.models import Event
from labweb.resources.models import Connection, Resource
from tests.builders import Bench, off
from tests.labweb.crutd.hand import done, node, post, pour, refused, rows
from tests.labweb.crutd.test_places import archived, created, moved
from tests.labweb.web import call, signed_in

POSE = {"x_mm": 1.0, "y_mm": 2.0, "z_mm": 3.0, "rotation_wxyz": [1.0, 0.0, 0.0, 0.0]}


def restored(bench: Bench, key: str, **to: str) -> dict[str, Any]:
    return {"op": "restore", "resource_id": node(bench, key), **to}


def test_a_full_bottle_and_a_plumbed_one_are_not_archived(bench: Bench) -> None:
    operation = archived(bench, "water")
    client = signed_in(bench.people["chemist"])
    answer = call(client, "POST", "/api/v1/operations/check", {"operation": operation})
    told = json.loads(answer.content)
    codes = [one["code"] for one in told["findings"]]
    assert codes[0] == "crutd.holds_matter"
    assert set(codes) == {"crutd.holds_matter", "crutd.connected"}
    assert "dispose of it, first" in told["findings"][0]["message"]
    assert "take this connection off first" in told["findings"][1]["message"]
    before = bench.node("water")
    assert call(client, "POST", "/api/v1/operations", {"operation": operation}).status_code == 412
    assert (bench.node("water").pose, bench.node("water").parent_id) == (
        before.pose,
        before.parent_id,
    )
    bench.unplug("water")
    refused(bench, operation, "crutd.holds_matter")
    done(bench, {"op": "dispose", "resource_id": node(bench, "water")})
    done(bench, operation)


def test_what_holds_something_keeps_all_that_it_stands_in_out_of_the_archive(bench: Bench) -> None:
    done(bench, created(bench, "rack", "tube_rack"))
    done(bench, created(bench, "tube_9", "tube", "rack", capacity_ul=1000))
    done(bench, pour(bench, "water", "tube_9", 1_000_000))
    told = refused(bench, archived(bench, "rack"), "crutd.holds_matter")
    assert "Tube 9, which stands in Rack, holds 1" in told["message"]


def test_what_is_plumbed_keeps_all_that_it_stands_in_out_of_the_archive(bench: Bench) -> None:
    client, operation = signed_in(bench.people["chemist"]), archived(bench, "balance_1")
    answer = call(client, "POST", "/api/v1/operations", {"operation": operation})
    told = json.loads(answer.content)
    assert (answer.status_code, told["code"]) == (412, "crutd.connected")
    assert bench.node("flask_1").name in told["message"]


@pytest.mark.parametrize("key", ["ph_1", "reactor_1"])
def test_a_probe_in_a_vessel_keeps_both_out_of_the_archive(bench: Bench, key: str) -> None:
    link = Connection.objects.get(key="ph_1_reactor_1")
    assert link.medium == "mechanical"
    for other in Connection.objects.filter(Q(source__key=key) | Q(target__key=key)):
        if other != link:
            admin = bench.people["admin"].pk
            crutd_services.carry_out(off(other), lab=bench.lab, actor_id=admin, note="off")
    told = refused(bench, archived(bench, key), "crutd.connected")
    assert f"{bench.node(key).name} is connected by ph_1_reactor_1 (mechanical)" in told["message"]
    assert "take this connection off first" in told["message"]
    bench.unplug(key)
    done(bench, archived(bench, key))


def test_a_probe_in_a_vessel_keeps_what_it_stands_in_out_of_the_archive(bench: Bench) -> None:
    done(bench, created(bench, "holder", "carrier"))
    Resource.objects.filter(key="ph_1").update(parent=bench.node("holder"))
    for link in Connection.objects.filter(source__key="ph_1").exclude(medium="mechanical"):
        link.delete()
    operation = {"operation": archived(bench, "holder")}
    client = signed_in(bench.people["chemist"])
    told = json.loads(call(client, "POST", "/api/v1/operations/check", operation).content)
    assert [one["code"] for one in told["findings"]] == ["crutd.connected"]


def test_a_restore_brings_a_thing_back_to_its_place_with_its_pose(bench: Bench) -> None:
    before = bench.unplug("flask_1")
    assert before.pose is not None
    done(bench, archived(bench, "flask_1"))
    assert bench.node("flask_1").pose is None
    told = Event.objects.order_by("-seq")[0].body["operation"]
    assert (told["from_id"], told["pose"]) == (str(before.parent_id), before.pose)
    done(bench, restored(bench, "flask_1"))
    after = bench.node("flask_1")
    assert (after.parent_id, after.pose, after.is_archived) == (
        before.parent_id,
        before.pose,
        False,
    )


def test_a_restore_asks_where_when_the_place_is_taken_meanwhile(bench: Bench) -> None:
    bench.unplug("flask_1")
    bench.unplug("flask_2")
    done(bench, archived(bench, "flask_1"))
    done(bench, moved(bench, "flask_2", "balance_1"))
    told = refused(bench, restored(bench, "flask_1"), "place.occupied")
    assert "choose another place" in told["message"]
    done(bench, restored(bench, "flask_1", to_id=node(bench, "bench_1")))
    assert bench.node("flask_1").pose is None


def test_a_restore_to_another_place_does_not_take_the_old_pose_along(bench: Bench) -> None:
    bench.unplug("flask_1")
    done(bench, archived(bench, "flask_1"))
    done(
        bench,
        restored(bench, "flask_1", to_id=node(bench, "bench_1"), from_id=node(bench, "archive")),
    )
    assert bench.node("flask_1").pose is None


def test_the_pose_of_what_was_archived_before_it_was_written_down_is_found_in_the_events(
    bench: Bench,
) -> None:
    before = bench.unplug("flask_1")
    done(bench, archived(bench, "flask_1"))
    event = Event.objects.order_by("-seq")[0]
    assert event.body["operation"].pop("pose") == before.pose
    del event.body["operation"]["from_id"]
    from labweb.crutd.selectors import archive as selectors  # noqa: PLC0415 - beside its use

    found = selectors.place_before(bench.node("flask_1"), event)
    assert found == (before.parent_id, before.pose)


def test_who_restores_does_not_say_the_pose(bench: Bench) -> None:
    bench.unplug("flask_1")
    done(bench, archived(bench, "flask_1"))
    operation = restored(bench, "flask_1") | {"pose": {"x_mm": 9}}
    client = signed_in(bench.people["chemist"])
    answer = call(client, "POST", "/api/v1/operations", {"operation": operation})
    assert answer.status_code == 422
    assert Resource.objects.get(key="flask_1").is_archived


def test_what_is_in_the_archive_is_not_archived_again_nor_what_stands_in_it(bench: Bench) -> None:
    assert done(bench, created(bench, "rack", "tube_rack"))["summary"] == "Rack: added to the lab"
    done(bench, created(bench, "tube_9", "tube", "rack", capacity_ul=1000))
    done(bench, archived(bench, "rack"))
    for key, name in (("rack", "Rack"), ("tube_9", "Tube 9")):
        before = rows()
        status, told = post(bench, archived(bench, key))
        assert (status, told["code"], told["effect"]) == (409, "crutd.archived", "none")
        assert told["message"] == f"{name} is in the Archive already: nothing was done"
        assert rows() == before
