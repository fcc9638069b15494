"""Reads that belong together see one instant."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pytest
from django.db import connection

from labweb.common.database.reading import one_moment
from labweb.resources.selectors import Lab, labs
from labweb.resources.services import latch_stop
from tests.builders import Bench, a_lab

pytestmark = pytest.mark.django_db(transaction=True)


def stop(bench: Bench) -> None:
    """Write on a connection of its own, as another process does."""
    try:
        latch_stop(Lab.objects.get(), stop_id=bench.lab.id, user_id=bench.people["admin"].pk)
    finally:
        connection.close()


def test_what_is_written_in_between_is_seen_only_afterwards() -> None:
    bench = a_lab()
    with ThreadPoolExecutor(1) as elsewhere:
        with one_moment():
            assert not labs().get().is_stopped
            elsewhere.submit(stop, bench).result()
            assert not labs().get().is_stopped
        assert labs().get().is_stopped
