"""Admission of devices and sessions of hosts."""

from __future__ import annotations

from uuid import uuid4

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from labweb.accounts.models import AuditEntry
from labweb.domain.errors import DefinitionError, EnrollmentError, ForbiddenError, StateError
from labweb.enrollment import services
from labweb.enrollment.models import Device, EdgeHost
from labweb.runs.services.planning.lab_view import lab_view
from tests.builders import Bench, Edge, a_lab, an_edge


@pytest.fixture
def found(db: None) -> Bench:
    """The starter lab with its pH transmitter found and not admitted."""
    return a_lab(discovered=["ph_1"])


def test_a_candidate_is_neither_planned_for_nor_served(found: Bench) -> None:
    assert "ph_1" not in {device.key for device in lab_view(found.lab).devices}
    edge = Edge(found)
    welcome = services.open_session(edge.hello("n"), "n")
    assert "ph_1" not in {device.key for device in welcome.devices}


def test_an_admitted_device_is_served_and_the_reason_is_kept(found: Bench) -> None:
    device = found.device("ph_1")
    services.admit_device(device.id, actor=found.people["admin"], reason="checked the label")
    assert found.device("ph_1").state == "enrolled"
    assert found.device("ph_1").admitted_by == found.people["admin"]
    entry = AuditEntry.objects.get(action="device.admit")
    assert (entry.reason, entry.actor) == ("checked the label", found.people["admin"])
    assert "ph_1" in {device.key for device in lab_view(found.lab).devices}


@pytest.mark.parametrize("role", ["observer", "chemist", "approver"])
def test_only_an_admin_admits(found: Bench, role: str) -> None:
    with pytest.raises(ForbiddenError):
        services.admit_device(found.device("ph_1").id, actor=found.people[role], reason="looks ok")
    assert found.device("ph_1").state == "candidate"


def test_nobody_is_admitted_without_a_reason(found: Bench) -> None:
    with pytest.raises(DefinitionError) as refusal:
        services.admit_device(found.device("ph_1").id, actor=found.people["admin"], reason=" ")
    assert refusal.value.code == "device.no_reason"


def test_a_suspended_device_is_out_and_can_come_back(bench: Bench) -> None:
    device, admin = bench.device("ph_1"), bench.people["admin"]
    services.suspend_device(device.id, actor=admin, reason="drifts")
    assert "ph_1" not in {device.key for device in lab_view(bench.lab).devices}
    with pytest.raises(StateError):
        services.suspend_device(device.id, actor=admin, reason="again")
    services.admit_device(device.id, actor=admin, reason="calibrated")
    assert bench.device("ph_1").state == Device.State.ENROLLED


def test_a_session_raises_the_epoch_and_a_heartbeat_of_an_older_one_is_refused(
    bench: Bench,
) -> None:
    edge = an_edge(bench)
    first = edge.epoch
    edge.connect()
    assert edge.epoch == first + 1
    assert services.beat(edge.host_id, first, {}) is False
    assert services.beat(edge.host_id, edge.epoch, {"seq_head": 0}) is True


def test_a_hello_signed_with_another_key_is_refused(bench: Bench) -> None:
    edge = Edge(bench, key=Ed25519PrivateKey.generate())
    with pytest.raises(EnrollmentError) as refusal:
        services.open_session(edge.hello("n"), "n")
    assert refusal.value.code == "host.bad_signature"
    assert bench.host.epoch == 0


def test_a_hello_over_another_nonce_is_refused(bench: Bench) -> None:
    hello = Edge(bench).hello("yesterday")
    with pytest.raises(EnrollmentError) as refusal:
        services.open_session(hello, "today")
    assert refusal.value.code == "host.bad_signature"


def test_an_unknown_and_a_revoked_host_are_refused(bench: Bench) -> None:
    edge = Edge(bench)
    edge.host_id = uuid4()
    with pytest.raises(EnrollmentError) as refusal:
        services.open_session(edge.hello("n"), "n")
    assert refusal.value.code == "host.unknown"
    EdgeHost.objects.update(state="revoked")
    with pytest.raises(EnrollmentError) as refusal:
        services.open_session(Edge(bench).hello("n"), "n")
    assert refusal.value.code == "host.revoked"


def test_a_journal_that_went_back_is_quarantined(bench: Bench) -> None:
    edge = an_edge(bench)
    edge.report("boot", None)
    edge.report("armed", None)
    del edge.events[1:]
    welcome = services.open_session(edge.hello("n"), "n")
    assert welcome.mode == "quarantine"
    assert bench.host.state == "quarantined"


def test_a_silent_host_is_suspect_and_then_isolated(bench: Bench) -> None:
    edge = an_edge(bench)
    for silent_s, state in ((9.0, "online"), (10.0, "suspect"), (30.0, "isolated")):
        services.watch_hosts({edge.host_id: silent_s})
        assert bench.host.state == state
    services.beat(edge.host_id, edge.epoch, {})
    assert bench.host.state == "online"
