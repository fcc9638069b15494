"""What the inbox has back of a device that is retired."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from pytest_django import Settings

from labweb.common.signatures import authority
from labweb.domain.errors import StateError
from labweb.enrollment import selectors, services
from labweb.enrollment.models import Candidate, Device
from tests.builders import Bench, an_edge, public_half
from tests.labweb.enrollment.test_discovery import a_sighting, another, seen, taken_up
from tests.labweb.fleet.test_device_retirement import retired


@pytest.fixture(autouse=True)
def _own_authority(settings: Settings, tmp_path: Path) -> Iterator[None]:
    settings.DATA_DIR = tmp_path
    yield
    authority._load.cache_clear()


@pytest.mark.parametrize("outcome", ["quarantined", "ignored"])
def test_the_inbox_has_it_as_if_it_had_never_been_taken_up(bench: Bench, outcome: str) -> None:
    edge = an_edge(bench)
    one = a_sighting()
    services.take_sightings(edge.host_id, edge.epoch, [one])
    row = Candidate.objects.get()
    device = taken_up(bench, row)
    retired(bench, device, outcome)
    services.take_sightings(edge.host_id, edge.epoch, [one])
    row.refresh_from_db()
    assert (row.state, row.label, row.seen_count) == (outcome, "RCT 0815", 2)
    assert row not in selectors.new_candidates(bench.lab)
    services.set_candidate_aside(row.id, "new", reason="looked", actor=bench.people["admin"])
    assert row in selectors.new_candidates(bench.lab)
    with pytest.raises(StateError) as refusal:
        taken_up(bench, row)
    assert refusal.value.code == "device.name_taken"
    assert "retired" in refusal.value.message
    again = taken_up(bench, row, "Plate 3")
    assert (again.state, again.pk == device.pk) == ("candidate", False)


def test_a_key_that_is_rejected_is_blocked_in_the_whole_lab(bench: Bench) -> None:
    edge, other = an_edge(bench), another(bench)
    key = public_half(Ed25519PrivateKey.generate())
    first, second = (seen(bench, one, public_key=key) for one in (edge, other))
    retired(bench, taken_up(bench, first), "rejected")
    third = seen(bench, another(bench, "third"), public_key=key)
    for row in (first, second, third):
        row.refresh_from_db()
        assert (row.state, row.reason) == ("rejected", "code differs")
        with pytest.raises(StateError):
            taken_up(bench, row, "Plate 3")


def test_whoever_says_that_he_is_it_says_so_of_nobody(bench: Bench) -> None:
    edge = an_edge(bench)
    device = taken_up(bench, seen(bench, edge))
    claims = seen(bench, edge)
    assert claims.key_changed_from is not None
    retired(bench, device, "quarantined")
    claims.refresh_from_db()
    assert claims.key_changed_from is None
    assert seen(bench, edge).key_changed_from is None
    assert taken_up(bench, claims, "Plate 3").pk != device.pk


def test_who_took_the_place_of_a_known_device_gives_both_back(bench: Bench) -> None:
    edge, admin = an_edge(bench), bench.people["admin"]
    known = seen(bench, edge)
    device = taken_up(bench, known)
    services.admit_device(device.id, actor=admin, reason="seen")
    claims = seen(bench, edge)
    assert taken_up(bench, claims).pk == device.pk
    retired(bench, device, "rejected")
    known.refresh_from_db()
    claims.refresh_from_db()
    assert (known.state, claims.state) == ("new", "rejected")
    taken_up(bench, known, "Plate 3")


def test_what_was_admitted_is_not_set_aside(bench: Bench) -> None:
    admin = bench.people["admin"]
    device = taken_up(bench, seen(bench, an_edge(bench)))
    services.admit_device(device.id, actor=admin, reason="seen")
    for is_suspended in (False, True):
        if is_suspended:
            services.suspend_device(device.id, actor=admin, reason="drifts")
        with pytest.raises(StateError) as refusal:
            retired(bench, device, "rejected")
        assert refusal.value.code == "device.was_admitted"
    assert retired(bench, device).state == "retired"


def test_what_came_with_the_lab_goes_into_no_inbox(bench: Bench) -> None:
    Device.objects.filter(key="timer_1").update(state="candidate")
    with pytest.raises(StateError) as refusal:
        retired(bench, bench.device("timer_1"), "quarantined")
    assert refusal.value.code == "device.no_candidate"
    assert bench.device("timer_1").state == "candidate"
