"""A driver is tried on a simulated instrument before anybody approves it, and touches nothing."""

from __future__ import annotations

from datetime import timedelta
from typing import Any
from uuid import UUID, uuid4

import msgspec
import pytest

from fixtures.instruments.single import offers
from labweb.accounts.models import AuditEntry
from labweb.approvals import selectors, services
from labweb.approvals.models import Tryout
from labweb.approvals.services import TryoutWanted, TryoutWish
from labweb.common import clock
from labweb.common.signatures import signing
from labweb.crutd.models import Transaction
from labweb.domain.enrollment.driver_bundle import decode_bundle
from labweb.domain.errors import (
    DefinitionError,
    ForbiddenError,
    LabError,
    LockedError,
    NotFoundError,
    PreconditionError,
    StateError,
)
from labweb.domain.messages.driver_tryouts import (
    SimulatedModel,
    TryoutAsk,
    TryoutOffer,
    TryoutOrder,
    TryoutPart,
    TryoutTold,
    WireRecord,
)
from labweb.enrollment.models import Device, DriverVersion
from labweb.resources.models import Resource
from labweb.runs.models import Job
from tests.builders import Bench, Edge, an_edge, catalog
from tests.labweb.web import call, code_of, read, signed_in

LOOP = "drivers.processing.lauda_loop"
MODELS = [msgspec.convert(one, SimulatedModel) for one in offers()]
REACH = {"temperature_c": 30.0, "tolerance_c": 0.5}


def a_version(bench: Bench) -> DriverVersion:
    """Have the admin propose another version of the thermostat's driver."""
    text = catalog()[f"{LOOP}:LaudaLoop"].sources[LOOP] + "\n# mine\n"
    actor = bench.people["admin"]
    return services.submit_driver(LOOP, text, note="mine", actor=actor)


def a_simulating_edge(bench: Bench) -> Edge:
    edge = an_edge(bench)
    offer = TryoutOffer(epoch=edge.epoch, models=MODELS)
    services.take_offer(edge.host_id, edge.epoch, offer)
    return edge


def wanted(bench: Bench, **changes: Any) -> TryoutWanted:  # noqa: ANN401 - any field
    known = TryoutWanted(host_id=bench.host.id, model="lauda_loop", speed=20.0)
    return msgspec.structs.replace(known, **changes)


def begun(bench: Bench, edge: Edge, version: DriverVersion | None = None) -> Tryout:
    """Begin a tryout, and let its host say that it runs."""
    version = version or a_version(bench)
    row = services.begin_tryout(version.id, wanted(bench), actor=bench.people["admin"])
    tell(edge, row)
    row.refresh_from_db()
    return row


def tell(edge: Edge, row: Tryout, **fields: Any) -> None:  # noqa: ANN401 - fields of the frame
    told = TryoutTold(epoch=edge.epoch, tryout_id=row.id, **{"state": "running", **fields})
    services.take_told(edge.host_id, edge.epoch, told)


def ask(bench: Bench, row: Tryout, sort: Any, name: str = "", **args: Any) -> int:  # noqa: ANN401 - JSON
    wish = TryoutWish(sort=sort, name=name, args=args)
    return services.ask_tryout(row.id, wish, actor=bench.people["admin"]).number


def test_an_unapproved_version_goes_to_its_host_with_a_signed_order(bench: Bench) -> None:
    edge = a_simulating_edge(bench)
    version = a_version(bench)
    counts = [kind.objects.count() for kind in (Device, Resource, Job, Transaction)]
    row = services.begin_tryout(version.id, wanted(bench), actor=bench.people["admin"])
    parts = services.frames_of(edge.host_id, edge.epoch, row.id, 0)
    assert all(isinstance(part, TryoutPart) for part in parts)
    data = b"".join(part.data for part in parts if isinstance(part, TryoutPart))
    assert decode_bundle(data, version.digest) == version.sources
    first = parts[0]
    assert isinstance(first, TryoutPart)
    assert first.order is not None
    text = first.order.body.encode()
    assert signing.is_signed_by(signing.public_key(), text, first.order.signature)
    order = msgspec.json.decode(text, type=TryoutOrder)
    assert (order.host_id, order.epoch, order.digest) == (edge.host_id, edge.epoch, version.digest)
    assert services.frames_of(edge.host_id, edge.epoch + 1, row.id, 0) == []
    assert services.frames_of(uuid4(), edge.epoch, row.id, 0) == []
    assert counts == [kind.objects.count() for kind in (Device, Resource, Job, Transaction)]
    version.refresh_from_db()
    assert (version.state, version.approval) == ("proposed", {})
    assert AuditEntry.objects.get(subject=str(row.id)).action == "driver.tryout"


def test_wishes_are_checked_sent_answered_and_summed_up(bench: Bench) -> None:
    edge = a_simulating_edge(bench)
    row = begun(bench, edge)
    number = ask(bench, row, "act", "reach_temperature", **REACH)
    (frame,) = services.frames_of(edge.host_id, edge.epoch, row.id, number)
    assert isinstance(frame, TryoutAsk)
    assert (frame.name, frame.args) == ("reach_temperature", REACH)
    records = [WireRecord(1, 0.1, "in", "4f4b"), WireRecord(2, 0.2, "out", "0d0a")]
    tell(edge, row, number=number, data={"evidence": {"temperature_c": 30.0}}, wire=records)
    tell(edge, row, number=ask(bench, row, "fault", "no_answer"), faults=["no_answer"])
    silent = ask(bench, row, "act", "stop_control")
    tell(edge, row, number=silent, code="device.timeout", effect="unknown", faults=["no_answer"])
    tell(edge, row, number=ask(bench, row, "cure"))
    values = {"values": {"temperature_c": 30.0}, "problems": {}}
    tell(edge, row, number=ask(bench, row, "read"), data=values)
    row.refresh_from_db()
    assert (row.statuses, row.faults, len(row.wire)) == (values, [], 2)
    found = selectors.tried_of(row.version)
    assert (found.actions, found.left_out) == (("reach_temperature",), ("hold", "stop_control"))
    assert (found.failed, found.faults, found.statuses_were_read) == ((), ("no_answer",), True)


@pytest.mark.parametrize(
    ("sort", "name", "args", "refusal"),
    [
        ("act", "reach_temperature", {"temperature_c": 500.0}, PreconditionError),
        ("act", "fly", {}, NotFoundError),
        ("fault", "dark", {}, NotFoundError),
        ("fault", "slow_reply", {"delay_s": "long"}, DefinitionError),
        ("fault", "slow_reply", {}, DefinitionError),
        ("read", "temperature_c", {}, DefinitionError),
    ],
)
def test_a_wish_that_does_not_fit_is_refused_and_never_sent(
    bench: Bench, sort: str, name: str, args: dict[str, Any], refusal: type[LabError]
) -> None:
    row = begun(bench, a_simulating_edge(bench))
    with pytest.raises(refusal):
        ask(bench, row, sort, name, **args)
    assert not row.acts.exists()


@pytest.mark.parametrize(
    ("changes", "subject"),
    [
        ({"settings": {"no_such": 1}}, "lauda_loop"),
        ({"config": {"settle_s": -1.0}}, "LaudaLoop.settle_s"),
        ({"speed": 1000.0}, "speed"),
        ({"speed": float("nan")}, "speed"),
    ],
)
def test_settings_that_do_not_fit_are_refused_with_every_finding(
    bench: Bench, changes: dict[str, Any], subject: str
) -> None:
    a_simulating_edge(bench)
    version = a_version(bench)
    with pytest.raises(DefinitionError) as refusal:
        services.begin_tryout(version.id, wanted(bench, **changes), actor=bench.people["admin"])
    assert [one.subject for one in refusal.value.findings] == [subject]
    assert not Tryout.objects.exists()


def test_a_model_that_does_not_fit_or_a_host_that_offers_nothing_is_refused(bench: Bench) -> None:
    version = a_version(bench)
    admin = bench.people["admin"]
    with pytest.raises(StateError) as refusal:
        services.begin_tryout(version.id, wanted(bench), actor=admin)
    assert refusal.value.code == "tryout.no_host"
    edge = a_simulating_edge(bench)
    with pytest.raises(NotFoundError):
        services.begin_tryout(version.id, wanted(bench, model="modbus_ph"), actor=admin)
    edge.connect()
    with pytest.raises(StateError) as refusal:
        services.begin_tryout(version.id, wanted(bench), actor=admin)
    assert refusal.value.code == "tryout.no_host", "an offer of an earlier session counts no more"


def test_a_host_tries_two_drivers_at_a_time_and_forgets_the_silent(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    edge = a_simulating_edge(bench)
    version = a_version(bench)
    first, _ = begun(bench, edge, version), begun(bench, edge, version)
    with pytest.raises(LockedError):
        begun(bench, edge, version)
    later = clock.now() + timedelta(seconds=60)
    monkeypatch.setattr(selectors, "now", lambda: later)
    assert selectors.is_over(first)
    with pytest.raises(StateError):
        ask(bench, first, "read")


def test_what_a_host_says_of_another_session_or_after_the_end_counts_nothing(bench: Bench) -> None:
    edge = a_simulating_edge(bench)
    row = begun(bench, edge)
    stranger = TryoutTold(epoch=edge.epoch, tryout_id=row.id, state="ended", message="ha")
    services.take_told(uuid4(), edge.epoch, stranger)
    services.take_told(edge.host_id, edge.epoch - 1, stranger)
    row.refresh_from_db()
    assert row.state == "running"
    tell(edge, row, state="ended", message="its author ended it")
    tell(edge, row)
    row.refresh_from_db()
    assert (row.state, row.message) == ("ended", "its author ended it")
    assert services.frames_of(edge.host_id, edge.epoch, row.id, 0) == []


def test_a_version_that_was_rejected_is_not_tried(bench: Bench) -> None:
    a_simulating_edge(bench)
    version = a_version(bench)
    services.decide_driver(
        version.id, actor=bench.people["approver"], is_approved=False, comment="no"
    )
    with pytest.raises(StateError):
        services.begin_tryout(version.id, wanted(bench), actor=bench.people["admin"])


@pytest.mark.parametrize("role", ["observer", "chemist", "approver"])
def test_only_who_may_bring_drivers_tries_them(bench: Bench, role: str) -> None:
    edge = a_simulating_edge(bench)
    row = begun(bench, edge)
    with pytest.raises(ForbiddenError):
        services.begin_tryout(row.version_id, wanted(bench), actor=bench.people[role])
    wish = TryoutWish(sort="stop")
    with pytest.raises(ForbiddenError):
        services.ask_tryout(row.id, wish, actor=bench.people[role])


def test_the_pages_say_where_a_version_can_be_tried_and_what_was_tried(bench: Bench) -> None:
    edge = a_simulating_edge(bench)
    version, admin = a_version(bench), signed_in(bench.people["admin"])
    found = read(admin, f"/api/v1/drivers/{version.id}/tryouts")
    (host,) = found["hosts"]
    models = [one["model"] for one in host["models"]]
    assert models[0] == "lauda_loop", "the one of the same name comes first"
    assert "huber_pb" in models
    assert "mettler_sics" not in models
    body = {"host_id": str(bench.host.id), "model": "lauda_loop"}
    answer = call(admin, "POST", f"/api/v1/drivers/{version.id}/tryouts", body)
    assert answer.status_code == 201, answer.content
    row = Tryout.objects.get()
    tell(edge, row)
    wish = {"sort": "act", "name": "stop_control"}
    assert call(admin, "POST", f"/api/v1/tryouts/{row.id}/wishes", wish).status_code == 201
    tell(edge, row, number=1)
    detail = read(admin, f"/api/v1/tryouts/{row.id}")
    assert [(act["name"], act["code"]) for act in detail["acts"]] == [("stop_control", "")]
    seen = read(signed_in(bench.people["approver"]), f"/api/v1/drivers/{version.id}")
    assert seen["tried"]["actions"] == ["stop_control"]
    bad = call(admin, "POST", f"/api/v1/tryouts/{UUID(int=1)}/wishes", wish)
    assert (bad.status_code, code_of(bad)) == (404, "tryout.not_found")


def test_a_driver_that_answers_at_length_fills_no_database(bench: Bench) -> None:
    edge = a_simulating_edge(bench)
    row = begun(bench, edge)
    number = ask(bench, row, "act", "stop_control")
    tell(edge, row, number=number, data={"evidence": {"text": "x" * 100_000}})
    assert row.acts.get(number=number).data.keys() == {"left_out_bytes"}
    for _ in range(30):
        tell(edge, row, wire=[WireRecord(n, 0.1, "in", "00" * 256) for n in range(50)])
    row.refresh_from_db()
    assert (len(row.wire), row.wire_left_out_count) == (400, 1100)
