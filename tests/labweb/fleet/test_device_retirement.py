"""A device ends: only once nothing of it acts, waits or holds anything; the inbox has it back."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest
from django.db import connection
from django.db.models import Q
from pytest_django import DjangoCaptureOnCommitCallbacks, Settings

from labweb.accounts.models import AuditEntry
from labweb.common.signatures import authority
from labweb.crutd import services as crutd_services
from labweb.crutd.models import Event
from labweb.domain.crutd.operations import Restore, TransferLiquid
from labweb.domain.errors import (
    DefinitionError,
    ForbiddenError,
    LabError,
    PreconditionError,
    StateError,
)
from labweb.enrollment import selectors, services
from labweb.enrollment.models import Candidate, Device
from labweb.fleet.services.device_retirement import retire_device
from labweb.resources.models import Connection, Resource
from tests.builders import (
    Bench,
    Edge,
    a_started_run,
    a_user,
    an_edge,
    dispatched,
    next_job,
)
from tests.labweb.crutd.test_adopting import adopted
from tests.labweb.enrollment.test_discovery import seen, taken_up


@pytest.fixture(autouse=True)
def _own_authority(settings: Settings, tmp_path: Path) -> Iterator[None]:
    settings.DATA_DIR = tmp_path
    yield
    authority._load.cache_clear()


def retired(bench: Bench, device: Device, outcome: str = "", who: str = "admin") -> Device:
    return retire_device(device.id, actor=bench.people[who], reason="code differs", outcome=outcome)


def refused(bench: Bench, device: Device, **how: str) -> PreconditionError:
    """Try it, and see that nothing of it was done."""
    before = (device.state, Event.objects.count(), AuditEntry.objects.count())
    with pytest.raises(PreconditionError) as refusal:
        retired(bench, device, **how)
    device.refresh_from_db()
    assert (device.state, Event.objects.count(), AuditEntry.objects.count()) == before
    assert refusal.value.code == "device.in_use"
    return refusal.value


def codes(error: PreconditionError) -> set[str]:
    return {one.code for one in error.findings}


def served(edge: Edge) -> set[str]:
    services.close_session(edge.host_id, edge.epoch)
    welcome = services.open_session(edge.hello("n"), "n")
    edge.epoch = welcome.epoch
    return {one.key for one in welcome.devices}


# --- what leaves, and what stays ---


@pytest.mark.parametrize("is_admitted", [False, True])
def test_a_device_leaves_with_its_parts_and_is_not_served(bench: Bench, is_admitted: bool) -> None:
    edge, admin = an_edge(bench), bench.people["admin"]
    device = adopted(bench, seen(bench, edge))
    if is_admitted:
        services.admit_device(device.id, actor=admin, reason="seen")
        assert "pump_9" in served(edge)
    retired(bench, device)
    assert bench.device("pump_9").state == "retired"
    assert "pump_9" not in served(edge)
    archive = Resource.objects.get(kind="archive")
    parts = [bench.node(key) for key in ("pump_9", "pump_9_valve")]
    assert all(part.is_archived and part.parent_id == archive.id for part in parts)
    told = Event.objects.order_by("-seq")[:2]
    assert {one.body["operation"]["op"] for one in told} == {"delete"}
    entry = AuditEntry.objects.get(action="device.retire")
    assert (entry.actor, entry.reason, entry.subject) == (admin, "code differs", str(device.id))
    assert entry.detail["gone"] == sorted(str(part.id) for part in parts)
    assert entry.detail["from"] == ("enrolled" if is_admitted else "candidate")
    row = Candidate.objects.get()
    assert (row.state, row.reason) == ("new", "code differs")


def test_parts_of_a_retired_device_come_back_by_hand_as_what_belongs_to_none(bench: Bench) -> None:
    device = adopted(bench, seen(bench, an_edge(bench)))
    retired(bench, device)
    part, bench_1 = bench.node("pump_9"), bench.node("bench_1")
    assert part.parent_id is not None
    back = Restore(resource_id=part.id, from_id=part.parent_id, to_id=bench_1.id)
    crutd_services.carry_out(back, lab=bench.lab, actor_id=bench.people["admin"].pk)
    part = bench.node("pump_9")
    assert (part.is_archived, part.parent_id) == (False, bench_1.id)
    assert bench.device("pump_9").state == "retired"
    assert Connection.objects.filter(source=part, target=bench.node("pump_9_valve")).exists()
    with pytest.raises(StateError) as refusal:
        services.admit_device(device.id, actor=bench.people["admin"], reason="again")
    assert refusal.value.code == "device.not_candidate"


def test_the_tree_without_it_is_rebuilt_from_its_events(bench: Bench) -> None:
    retired(bench, adopted(bench, seen(bench, an_edge(bench))))
    Resource.objects.filter(key="pump_9_valve").update(is_archived=False, name="wrong")
    crutd_services.rebuild(bench.lab)
    assert bench.node("pump_9_valve").is_archived


def test_a_flask_that_it_heated_stays_with_what_is_in_it(bench: Bench) -> None:
    device = taken_up(bench, seen(bench, an_edge(bench)))
    flask = bench.node("flask_2")
    events = Event.objects.count()
    retired(bench, device)
    after = bench.node("flask_2")
    assert (after.is_archived, after.parent_id) == (False, flask.parent_id)
    assert Event.objects.count() == events


def test_a_device_that_acts_through_nothing_is_retired(bench: Bench) -> None:
    Device.objects.filter(key="timer_1").update(nodes={})
    assert retired(bench, bench.device("timer_1")).state == "retired"


def test_a_part_through_which_another_device_acts_stays(bench: Bench) -> None:
    device = adopted(bench, seen(bench, an_edge(bench)))
    valve = bench.node("pump_9_valve")
    Device.objects.filter(key="timer_1").update(nodes={"timer": str(valve.id)})
    Connection.objects.filter(target=valve).delete()
    retired(bench, device)
    assert bench.node("pump_9").is_archived
    assert not bench.node("pump_9_valve").is_archived


# --- what speaks against it ---


def _connected(bench: Bench, part: Resource) -> None:
    Connection.objects.create(
        lab=bench.lab, key="foreign", source=bench.node("pump_9_valve"), source_port="3",
        target=bench.node("flask_1"), target_port="top", medium="liquid",
    )  # fmt: skip


def _quarantined(bench: Bench, part: Resource) -> None:
    Resource.objects.filter(pk=part.pk).update(quarantined_by=uuid4())


def _reserved(bench: Bench, part: Resource) -> None:
    crutd_services.reserve(
        [part.id], holder_id=bench.people["chemist"].pk, lasts=timedelta(hours=1), reason="mine"
    )


def _occupied(bench: Bench, part: Resource) -> None:
    flask = bench.node("flask_2")
    Connection.objects.filter(Q(source=flask) | Q(target=flask)).delete()
    Resource.objects.filter(pk=flask.pk).update(parent=part)


def _filled(bench: Bench, part: Resource) -> None:
    water = bench.node("water")
    move = TransferLiquid(source_id=water.id, target_id=part.id, amount_nl=1_000_000)
    crutd_services.carry_out(move, lab=bench.lab, actor_id=bench.people["admin"].pk)


@pytest.mark.parametrize(
    ("spoil", "code"),
    [
        (_connected, "crutd.connected"),
        (_quarantined, "crutd.quarantined"),
        (_reserved, "crutd.reserved"),
        (_occupied, "crutd.occupied"),
        (_filled, "crutd.holds_matter"),
    ],
)
def test_a_part_that_is_not_free_keeps_the_device(bench: Bench, spoil: Any, code: str) -> None:  # noqa: ANN401
    device = adopted(bench, seen(bench, an_edge(bench)))
    spoil(bench, bench.node("pump_9"))
    assert codes(refused(bench, device)) == {code}
    assert not bench.node("pump_9_valve").is_archived


def test_every_finding_is_told_at_once(bench: Bench) -> None:
    device = adopted(bench, seen(bench, an_edge(bench)))
    for spoil in (_connected, _filled):
        spoil(bench, bench.node("pump_9"))
    error = refused(bench, device, outcome="rejected")
    assert codes(error) == {"crutd.connected", "crutd.holds_matter"}
    assert all(one.message in error.message for one in error.findings)
    assert Candidate.objects.get().state == "taken_up"


def test_doubts_about_what_it_heated_keep_it_too(bench: Bench) -> None:
    device = taken_up(bench, seen(bench, an_edge(bench)))
    flask = bench.node("flask_2")
    _quarantined(bench, flask)
    _reserved(bench, flask)
    assert codes(refused(bench, device)) == {"crutd.quarantined", "crutd.reserved"}


def test_a_lab_without_an_archive_keeps_its_devices(bench: Bench) -> None:
    device = adopted(bench, seen(bench, an_edge(bench)))
    Resource.objects.filter(kind="archive").update(is_archived=True)
    assert codes(refused(bench, device)) == {"crutd.no_archive"}


def test_jobs_that_wait_act_or_are_in_doubt_keep_it(bench: Bench) -> None:
    edge = an_edge(bench)
    run = a_started_run(bench)
    attempt = dispatched(run)
    device = attempt.job.device
    sentences = [one.message for one in refused(bench, device).findings]
    assert any(attempt.job.sentence in one and "under way" in one for one in sentences)
    assert any("it waits" in one for one in sentences)
    edge.lose(attempt)
    sentences = [one.message for one in refused(bench, device).findings]
    assert any(attempt.job.sentence in one and "in doubt" in one for one in sentences)


def test_jobs_of_another_device_that_use_its_part_keep_it(bench: Bench) -> None:
    an_edge(bench)
    run = a_started_run(bench)
    device = adopted(bench, seen(bench, an_edge(bench)))
    job = next_job(run)
    job.locks = [*job.locks, str(bench.node("pump_9_valve").id)]
    job.save()
    assert job.device_id != device.id
    assert codes(refused(bench, device)) == {"device.has_job"}


def test_a_doubt_about_what_lies_inside_a_part_keeps_it(bench: Bench) -> None:
    device = adopted(bench, seen(bench, an_edge(bench)))
    slot = bench.node("pump_9_valve")
    Resource.objects.filter(pk=slot.pk).update(
        parent=bench.node("pump_9"), kind="slot", quarantined_by=uuid4()
    )
    assert codes(refused(bench, device)) == {"crutd.quarantined"}


# --- who may, and twice ---


@pytest.mark.parametrize("role", ["observer", "chemist", "approver"])
@pytest.mark.parametrize("outcome", ["", "rejected"])
def test_only_who_admits_retires(bench: Bench, role: str, outcome: str) -> None:
    device = taken_up(bench, seen(bench, an_edge(bench)))
    with pytest.raises(ForbiddenError):
        retired(bench, device, outcome, who=role)
    assert bench.device("plate_2").state == "candidate"


def test_who_admits_at_one_bench_retires_there_and_blocks_no_key_of_the_lab(bench: Bench) -> None:
    device = adopted(bench, seen(bench, an_edge(bench)))
    keeper = a_user("admin", on=bench.node("bench_1"), name="keeper")
    with pytest.raises(ForbiddenError):
        retire_device(device.id, actor=keeper, reason="no", outcome="rejected")
    assert bench.device("pump_9").state == "candidate"
    assert retire_device(device.id, actor=keeper, reason="no").state == "retired"


def test_its_host_is_told_and_no_version_waits_for_it(
    bench: Bench, django_capture_on_commit_callbacks: DjangoCaptureOnCommitCallbacks
) -> None:
    device = taken_up(bench, seen(bench, an_edge(bench)))
    Device.objects.filter(pk=device.pk).update(
        next_driver=device.driver_id, is_next_ready=True, next_parts={"digest": "x"}
    )
    with django_capture_on_commit_callbacks() as told:
        retired(bench, device)
    hosts = [
        one.args[0]
        for one in told
        if isinstance(one, partial) and one.args[1:] == ({"type": "edge.renew"},)
    ]
    assert hosts == [device.host_id]
    assert not selectors.hosts_switching()
    assert bench.device("plate_2").next_driver is None


def test_a_reason_is_asked_for(bench: Bench) -> None:
    device = taken_up(bench, seen(bench, an_edge(bench)))
    with pytest.raises(DefinitionError) as refusal:
        retire_device(device.id, actor=bench.people["admin"], reason=" ")
    assert refusal.value.code == "device.no_reason"
    with pytest.raises(DefinitionError) as refusal:
        retired(bench, device, "melted")
    assert refusal.value.code == "candidate.no_answer"
    assert bench.device("plate_2").state == "candidate"


def test_it_is_retired_once(bench: Bench) -> None:
    device = taken_up(bench, seen(bench, an_edge(bench)))
    retired(bench, device, "ignored")
    for outcome in ("", "rejected"):
        with pytest.raises(StateError) as refusal:
            retired(bench, device, outcome)
        assert refusal.value.code == "device.retired"
    assert Candidate.objects.get().state == "ignored"
    with pytest.raises(StateError) as refusal:
        services.want_driver(
            device.id, device.driver_id, actor=bench.people["admin"], reason="new", waiting=[]
        )
    assert refusal.value.code == "device.retired"


@pytest.mark.django_db(transaction=True)
def test_of_two_who_decide_one_is_told_that_it_is_over(bench: Bench) -> None:
    device = adopted(bench, seen(bench, an_edge(bench)))
    is_time, answers = threading.Barrier(2), list[str]()

    def decide(outcome: str) -> None:
        try:
            is_time.wait(20)
            retired(bench, device, outcome)
            answers.append(outcome)
        except LabError as error:
            answers.append(error.code)
        finally:
            connection.close()

    both = [threading.Thread(target=decide, args=(one,)) for one in ("rejected", "ignored")]
    for one in both:
        one.start()
    for one in both:
        one.join()
    assert len(answers) == 2
    assert Candidate.objects.get().state in answers
    assert set(answers) - {"rejected", "ignored"} <= {"device.retired", "device.busy"}
    assert AuditEntry.objects.filter(action="device.retire").count() == 1
