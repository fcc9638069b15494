"""Who decides about a device, takes another key up for it or hears it: nobody waits in a ring."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from django.db import connection
from django.db.transaction import atomic
from pytest_django import Settings

from labweb.common.signatures import authority
from labweb.enrollment import selectors, services
from labweb.enrollment.models import Candidate
from labweb.enrollment.services.candidates import hold_candidate
from tests.builders import Bench, Edge, an_edge, public_half
from tests.fixtures.running import until
from tests.labweb.enrollment.test_discovery import a_sighting, taken_up


@pytest.fixture(autouse=True)
def _own_authority(settings: Settings, tmp_path: Path) -> Iterator[None]:
    settings.DATA_DIR = tmp_path
    yield
    authority._load.cache_clear()


def a_waiter() -> bool:
    with connection.cursor() as cursor:
        cursor.execute("SELECT count(*) FROM pg_locks WHERE NOT granted")
        return bool(cursor.fetchone()[0])


def beside(held: Callable[[], object], act: Callable[[], object]) -> list[object]:
    """Begin an act while one holds the candidates, and go on to the device as it waits."""
    done: list[object] = []

    def run() -> None:
        try:
            act()
            done.append("done")
        except Exception as error:  # noqa: BLE001 - told to the test
            done.append(error)
        finally:
            connection.close()

    thread = threading.Thread(target=run)
    with atomic():
        held()
        thread.start()
        until(a_waiter)
        device = Candidate.objects.get(device__isnull=False).device
        assert device is not None
        assert selectors.device_for_update(device.pk).state == "enrolled"
    thread.join(20)
    return done


def admitted_and_rival(bench: Bench) -> tuple[Edge, Candidate, Candidate]:
    edge = an_edge(bench)
    rows = []
    for _ in range(2):
        one = a_sighting(public_key=public_half(Ed25519PrivateKey.generate()))
        services.take_sightings(edge.host_id, edge.epoch, [one])
        rows.append(Candidate.objects.get(public_key=one.public_key))
        if len(rows) == 1:
            device = taken_up(bench, rows[0])
            services.admit_device(device.id, actor=bench.people["admin"], reason="looked")
    for row in rows:
        row.refresh_from_db()
    assert rows[1].key_changed_from == rows[0]
    return edge, rows[0], rows[1]


@pytest.mark.django_db(transaction=True)
def test_a_key_is_taken_up_while_its_device_is_decided_about(bench: Bench) -> None:
    _, known, rival = admitted_and_rival(bench)
    told = beside(lambda: hold_candidate(known), lambda: taken_up(bench, rival, "Plate 9"))
    assert told == ["done"]
    assert Candidate.objects.get(pk=rival.pk).state == "taken_up"


@pytest.mark.django_db(transaction=True)
def test_both_keys_are_heard_while_the_device_is_decided_about(bench: Bench) -> None:
    edge, known, rival = admitted_and_rival(bench)
    both = [a_sighting(public_key=one.public_key) for one in (rival, known)]
    told = beside(
        lambda: hold_candidate(known),
        lambda: services.take_sightings(edge.host_id, edge.epoch, both),
    )
    assert told == ["done"]
    assert set(Candidate.objects.values_list("seen_count", flat=True)) == {2}
