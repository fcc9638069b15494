"""Copies of a host, lost hosts, revoked keys."""

from __future__ import annotations

import pytest

from labweb.domain.errors import EnrollmentError, ForbiddenError, StateError
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.models import EdgeHost
from labweb.fleet.services import fencing
from tests.builders import Bench, a_started_run, a_user, an_edge, dispatched
from tests.labweb.web import read, signed_in


def test_a_second_process_is_refused_while_the_first_one_lives(bench: Bench) -> None:
    edge = an_edge(bench)
    EdgeHost.objects.filter(pk=edge.host_id).update(instance_id="one")
    with pytest.raises(EnrollmentError) as refusal:
        enrollment_services.open_session(edge.hello("n", instance_id="two"), "n")
    assert refusal.value.code == "host.rival"
    enrollment_services.close_session(edge.host_id, edge.epoch)
    welcome = enrollment_services.open_session(edge.hello("n", instance_id="two"), "n")
    assert welcome.mode == "normal"


def test_a_silent_process_gives_way_to_another(bench: Bench) -> None:
    edge = an_edge(bench)
    EdgeHost.objects.filter(pk=edge.host_id).update(instance_id="one")
    enrollment_services.watch_hosts({edge.host_id: 12.0})
    assert bench.host.state == "suspect"
    welcome = enrollment_services.open_session(edge.hello("n", instance_id="two"), "n")
    assert welcome.mode == "normal"


def test_a_start_of_the_machine_that_comes_back_after_another_is_a_copy(bench: Bench) -> None:
    edge = an_edge(bench)
    enrollment_services.open_session(edge.hello("n", boot_id="another"), "n")
    assert enrollment_services.open_session(edge.hello("n"), "n").mode == "quarantine"
    assert bench.host.heartbeat["code"] == "host.clone"


def test_a_journal_that_does_not_know_a_session_the_host_has_spoken_in_is_a_copy(
    bench: Bench,
) -> None:
    edge = an_edge(bench)
    beat = {"epoch": edge.epoch, "mono_s": 1.0, "seq_head": 0}
    assert enrollment_services.beat(edge.host_id, edge.epoch, beat)
    assert bench.host.epoch_seen == edge.epoch
    welcome = enrollment_services.open_session(edge.hello("n", epoch_last=0), "n")
    assert welcome.mode == "quarantine"
    assert bench.host.heartbeat["code"] == "host.epoch_regressed"


def test_a_device_that_is_to_be_halted_first_says_so_until_it_is(bench: Bench) -> None:
    edge = an_edge(bench)
    heater = str(bench.device("heater_1").id)

    def told() -> dict[str, bool]:
        rows = read(signed_in(bench.people["observer"]), "/api/v1/devices")["devices"]
        return {row["key"]: row["is_halt_owed"] for row in rows if row["is_halt_owed"]}

    assert told() == {}
    assert enrollment_services.beat(edge.host_id, edge.epoch, {"halts_owed": [heater]})
    assert told() == {"heater_1": True}
    assert enrollment_services.beat(edge.host_id, edge.epoch, {"halts_owed": []})
    assert told() == {}


def test_one_person_cannot_fence_a_host_alone_nor_one_that_answers(bench: Bench) -> None:
    edge = an_edge(bench)
    admin = bench.people["admin"]
    with pytest.raises(StateError) as answers:
        fencing.fence_host(edge.host_id, actor=admin, reason="gone")
    assert answers.value.code == "host.not_lost"
    enrollment_services.watch_hosts({edge.host_id: 40.0})
    assert bench.host.away_since_at is not None
    fencing.fence_host(edge.host_id, actor=admin, reason="gone")
    with pytest.raises(ForbiddenError) as alone:
        fencing.fence_host(edge.host_id, actor=admin, reason="really gone")
    assert alone.value.code == "host.same_person"
    with pytest.raises(ForbiddenError):
        fencing.fence_host(edge.host_id, actor=bench.people["chemist"], reason="gone")
    assert bench.host.state == "isolated"


def test_a_host_that_is_heard_of_withdraws_the_first_signature(bench: Bench) -> None:
    edge = an_edge(bench)
    enrollment_services.watch_hosts({edge.host_id: 40.0})
    fencing.fence_host(edge.host_id, actor=bench.people["admin"], reason="gone")
    edge.connect()
    assert enrollment_services.withdraw_fences() == 1
    enrollment_services.watch_hosts({edge.host_id: 40.0})
    other = a_user("admin", on=bench.node("lab"), name="other")
    fencing.fence_host(edge.host_id, actor=other, reason="gone again")
    assert bench.host.state == "isolated", "it is a first signature again"


def test_a_key_is_revoked_only_when_nothing_of_its_host_is_under_way(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = dispatched(run)
    admin = bench.people["admin"]
    with pytest.raises(StateError) as busy:
        fencing.revoke_host(edge.host_id, actor=admin, reason="stolen")
    assert busy.value.code == "host.in_flight"
    edge.complete(attempt)
    fencing.revoke_host(edge.host_id, actor=admin, reason="stolen")
    with pytest.raises(EnrollmentError) as refusal:
        enrollment_services.open_session(edge.hello("n"), "n")
    assert refusal.value.code == "host.revoked"
