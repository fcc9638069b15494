"""What strangers on the network can make of an inbox, and of a device that was admitted: little."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from django.db.models import F
from pytest_django import Settings

from labweb.accounts.models import AuditEntry
from labweb.common.signatures import authority
from labweb.domain.enrollment.announcement_trust import KEY_CHANGED_AFTER_S, LONGEST_GAP_S
from labweb.domain.enrollment.device_announcements import (
    MAKES_ROOM_AFTER_S,
    MOST_OF_ONE_PLACE,
    MOST_OPEN,
)
from labweb.domain.errors import StateError
from labweb.domain.messages.certificates_and_sightings import Sighting
from labweb.enrollment import selectors, services
from labweb.enrollment.models import Candidate, Device
from labweb.runs.services.planning.lab_view import lab_view
from tests.builders import Bench, Edge, an_edge, public_half
from tests.labweb.enrollment.test_discovery import a_sighting, another, seen, taken_up, wanted
from tests.labweb.web import signed_in

HERE, ELSEWHERE = "tcp://192.0.2.9:5000", "tcp://192.0.2.66:5000"
STEP_S = 15.0
"""How often a host tells the same thing again."""


@pytest.fixture(autouse=True)
def _own_authority(settings: Settings, tmp_path: Path) -> Iterator[None]:
    settings.DATA_DIR = tmp_path
    yield
    authority._load.cache_clear()


def a_key() -> str:
    return public_half(Ed25519PrivateKey.generate())


def passes(seconds: float) -> None:
    """Let time pass, as the record sees it."""
    back = timedelta(seconds=seconds)
    Candidate.objects.update(
        first_seen_at=F("first_seen_at") - back,
        last_seen_at=F("last_seen_at") - back,
        alone_since_at=F("alone_since_at") - back,
    )


class Wire:
    """A host, the device that it serves, and who says that he is that device."""

    def __init__(self, bench: Bench) -> None:
        self.bench, self.edge = bench, an_edge(bench)
        self.device_key = a_key()
        device = taken_up(bench, seen(bench, self.edge, public_key=self.device_key))
        services.admit_device(device.id, actor=bench.people["admin"], reason="ok")

    def hears(self, **fields: str) -> None:
        self.hears_at(self.edge, **fields)

    def hears_at(self, edge: Edge, **fields: str) -> None:
        services.take_sightings(edge.host_id, edge.epoch, [a_sighting(**fields)])

    def state(self) -> str:
        return self.bench.device("plate_2").state


@pytest.fixture
def wire(bench: Bench) -> Wire:
    return Wire(bench)


def hears_for(wire: Wire, seconds: float, *, with_device: bool = False, **fields: str) -> None:
    """Have one claim heard again and again, beside the device or without it."""
    for _ in range(int(seconds / STEP_S) + 1):
        wire.hears(**fields)
        if with_device:
            wire.hears(public_key=wire.device_key)
        passes(STEP_S)


def test_one_announcement_of_its_serial_number_suspends_nothing_and_stands_in_the_inbox(
    wire: Wire,
) -> None:
    for address in (HERE, ELSEWHERE):
        wire.hears(address=address)
    assert wire.state() == "enrolled"
    assert "plate_2" in {one.key for one in lab_view(wire.bench.lab).devices}
    rivals = selectors.new_candidates(wire.bench.lab)
    assert len(rivals) == 2
    assert {one.key_changed_from.device.key for one in rivals} == {"plate_2"}  # type: ignore[union-attr]
    assert not AuditEntry.objects.filter(action="device.key_changed").exists()
    page = signed_in(wire.bench.people["admin"]).get(
        f"/admin/enrollment/candidate/{rivals[0].id}/review/"
    )
    assert "has changed nothing about" in page.content.decode()


def test_a_key_is_changed_when_the_other_alone_is_heard_from_where_the_device_is(
    wire: Wire,
) -> None:
    passes(600)
    rival = a_key()
    hears_for(wire, KEY_CHANGED_AFTER_S - STEP_S, public_key=rival)
    assert wire.state() == "enrolled"
    wire.hears(public_key=rival)
    device = wire.bench.device("plate_2")
    assert (device.state, HERE in device.suspended_for) == ("suspended", True)
    assert "plate_2" not in {one.key for one in lab_view(wire.bench.lab).devices}
    assert AuditEntry.objects.get(action="device.key_changed").actor is None
    again = taken_up(wire.bench, Candidate.objects.get(public_key=rival))
    assert again.pk == device.pk
    services.admit_device(device.id, actor=wire.bench.people["admin"], reason="a new board")
    assert wire.state() == "enrolled"


def test_a_device_that_has_lost_its_key_is_suspended_as_well(wire: Wire) -> None:
    passes(600)
    hears_for(wire, KEY_CHANGED_AFTER_S + STEP_S, public_key="")
    assert wire.state() == "suspended"


def test_a_stranger_beside_the_device_never_suspends_it_however_long(wire: Wire) -> None:
    hears_for(wire, 20 * KEY_CHANGED_AFTER_S, with_device=True, public_key=a_key())
    assert wire.state() == "enrolled"


def test_a_stranger_at_another_address_never_suspends_it(wire: Wire) -> None:
    passes(600)
    hears_for(wire, 3 * KEY_CHANGED_AFTER_S, public_key=a_key(), address=ELSEWHERE)
    assert wire.state() == "enrolled"


def test_a_stranger_with_a_fresh_key_each_time_never_suspends_it(wire: Wire) -> None:
    passes(600)
    for _ in range(20):
        wire.hears(public_key=a_key())
        passes(STEP_S)
    assert wire.state() == "enrolled"


def test_two_datagrams_with_a_long_pause_between_suspend_nothing(wire: Wire) -> None:
    passes(600)
    rival = a_key()
    for _ in range(4):
        wire.hears(public_key=rival)
        passes(LONGEST_GAP_S + 1)
    assert wire.state() == "enrolled"


def test_what_another_host_hears_suspends_nothing(wire: Wire) -> None:
    other, rival = another(wire.bench), a_key()
    passes(600)
    for _ in range(20):
        wire.hears_at(other, public_key=rival)
        passes(STEP_S)
    assert wire.state() == "enrolled"


def test_a_key_that_was_heard_before_the_admission_counts_like_any(bench: Bench) -> None:
    edge, rival = an_edge(bench), a_key()
    early = a_sighting(public_key=rival)
    services.take_sightings(edge.host_id, edge.epoch, [early])
    device = taken_up(bench, seen(bench, edge))
    services.admit_device(device.id, actor=bench.people["admin"], reason="ok")
    passes(600)
    for _ in range(5):
        services.take_sightings(edge.host_id, edge.epoch, [early])
        passes(STEP_S)
    assert bench.device("plate_2").state == "suspended"


@pytest.mark.parametrize("answer", ["ignored", "rejected"])
def test_what_a_person_has_answered_suspends_nothing_any_more(wire: Wire, answer: str) -> None:
    rival = a_key()
    wire.hears(public_key=rival)
    row = Candidate.objects.get(public_key=rival)
    admin = wire.bench.people["admin"]
    services.set_candidate_aside(row.id, answer, reason="a stranger's", actor=admin)
    passes(600)
    hears_for(wire, 3 * KEY_CHANGED_AFTER_S, public_key=rival)
    assert wire.state() == "enrolled"


def test_who_takes_another_key_up_takes_the_device_out_of_service_first(wire: Wire) -> None:
    rival = a_key()
    wire.hears(public_key=rival)
    device = taken_up(wire.bench, Candidate.objects.get(public_key=rival))
    assert (device.key, device.state) == ("plate_2", "suspended")


def test_who_repeats_what_a_device_has_signed_moves_it_nowhere(bench: Bench) -> None:
    edge, one = an_edge(bench), a_sighting()
    repeated = a_sighting(public_key=one.public_key, address=ELSEWHERE)
    services.take_sightings(edge.host_id, edge.epoch, [one, repeated])
    row = Candidate.objects.get()
    assert (row.address, row.also_at) == (HERE, ELSEWHERE)
    url = f"/admin/enrollment/candidate/{row.id}/review/"
    page = signed_in(bench.people["admin"]).get(url).content.decode()
    assert ELSEWHERE in page
    assert f'name="transport" value="{HERE}"' not in page, "a person says which of the two it is"
    taken_up(bench, row)
    row.refresh_from_db()
    assert row.also_at == ""


# --- rejected once, rejected everywhere ---


@pytest.mark.parametrize(
    ("fields", "is_shared"),
    [
        ({"serial": "1"}, True),
        ({"serial": "1", "model": ""}, False),
        ({"serial": "", "address": "tcp://9.9.9.9:5000"}, True),
        ({"serial": "", "address": "tcp://[2606:4700::1]:5000"}, True),
        ({"serial": "", "address": "tcp://192.168.1.9:5000"}, False),
        ({"serial": "", "address": "tcp://[fe80::9]:5000"}, False),
        ({"serial": "", "address": "serial:///dev/ttyUSB0", "source": "serial"}, False),
    ],
)
def test_what_has_no_key_is_rejected_wherever_it_must_be_the_same(
    bench: Bench, fields: dict[str, str], is_shared: bool
) -> None:
    edge, other, third = an_edge(bench), another(bench), another(bench, "third")
    admin = bench.people["admin"]
    first, second = (seen(bench, one, public_key="", **fields) for one in (edge, other))
    services.set_candidate_aside(first.id, "rejected", reason="not ours", actor=admin)
    second.refresh_from_db()
    later = seen(bench, third, public_key="", **fields)
    assert {second.state, later.state} == {"rejected" if is_shared else "new"}
    if is_shared:
        with pytest.raises(StateError) as refusal:
            services.take_up(
                later.id,
                wanted(bench),
                typed=later.serial or later.address,
                reason="ok",
                actor=admin,
            )
        assert refusal.value.code == "candidate.rejected"
        services.set_candidate_aside(later.id, "new", reason="ours", actor=admin)
        first.refresh_from_db()
        assert first.state == "new"


def test_a_serial_number_that_makers_give_to_many_may_be_rejected_beside_a_device(
    bench: Bench,
) -> None:
    edge, other, admin = an_edge(bench), another(bench), bench.people["admin"]
    fields = {"public_key": "", "serial": "0001", "model": "10c4:ea60"}
    ours, theirs = (seen(bench, one, **fields) for one in (edge, other))
    device = services.take_up(ours.id, wanted(bench), typed="0001", reason="read", actor=admin)
    services.set_candidate_aside(theirs.id, "rejected", reason="not ours", actor=admin)
    ours.refresh_from_db()
    assert (ours.state, ours.device_id) == ("taken_up", device.id)


# --- the inbox ---


def test_one_sender_with_many_keys_leaves_room_for_others(bench: Bench) -> None:
    edge = an_edge(bench)
    for _ in range(2):
        many = [a_sighting(serial=str(at)) for at in range(50)]
        services.take_sightings(edge.host_id, edge.epoch, many)
    assert Candidate.objects.count() == MOST_OF_ONE_PLACE
    assert seen(bench, edge, address=ELSEWHERE).state == "new"


def fill(edge: Edge) -> None:
    for start in range(0, MOST_OPEN, 50):
        found = [
            a_sighting(serial=str(at), address=f"tcp://192.0.{at}.9:5000")
            for at in range(start, start + 50)
        ]
        services.take_sightings(edge.host_id, edge.epoch, found)
    assert Candidate.objects.count() == MOST_OPEN


def test_what_is_heard_no_more_makes_room_and_what_a_person_looks_at_does_not(
    bench: Bench,
) -> None:
    edge, admin = an_edge(bench), bench.people["admin"]
    fill(edge)
    kept = Candidate.objects.order_by("last_seen_at").first()
    assert kept is not None
    services.set_candidate_aside(kept.id, "quarantined", reason="looked at", actor=admin)
    late = a_sighting(address=ELSEWHERE, serial="late")
    assert services.take_sightings(edge.host_id, edge.epoch, [late]) == 0
    passes(MAKES_ROOM_AFTER_S + 1)
    assert services.take_sightings(edge.host_id, edge.epoch, [late]) == 1
    assert Candidate.objects.count() == MOST_OPEN
    assert Candidate.objects.filter(pk=kept.pk).exists()


def test_a_flood_of_announcements_hides_no_serial_port(bench: Bench) -> None:
    edge = an_edge(bench)
    fill(edge)
    port = Sighting(source="serial", address="serial:///dev/ttyUSB0")
    assert services.take_sightings(edge.host_id, edge.epoch, [port]) == 1


HOSTILE = {
    "not base64": {"public_key": "k"},
    "short": {"public_key": "AAAA"},
    "another way to write it": {"public_key": "A" * 42 + "B="},
    "direction of writing": {"serial": "0815\u202e"},
    "a sign that shows nothing": {"serial": "0815\u3164"},
    "accents in a tower": {"name": "e" + "\u0301" * 40},
    "two blanks": {"model": "R  CT"},
    "control": {"name": "a\x1b[2J"},
}


@pytest.mark.parametrize("what", HOSTILE)
def test_what_a_hostile_host_tells_is_not_kept_and_the_pages_stay_open(
    bench: Bench, what: str
) -> None:
    edge = an_edge(bench)
    assert services.take_sightings(edge.host_id, edge.epoch, [a_sighting(**HOSTILE[what])]) == 0
    assert not Candidate.objects.exists()


def test_a_name_of_markup_is_shown_as_it_was_written(bench: Bench) -> None:
    text = "<script>alert(1)</script>"
    row = seen(bench, an_edge(bench), name=text, model="<b>", serial="<i>")
    client = signed_in(bench.people["admin"])
    for url in ("/admin/enrollment/candidate/", f"/admin/enrollment/candidate/{row.id}/review/"):
        page = client.get(url).content.decode()
        assert text not in page
        assert "&lt;script&gt;" in page
    assert Device.objects.filter(name=text).count() == 0
