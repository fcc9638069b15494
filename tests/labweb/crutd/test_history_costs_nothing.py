"""What a lab did long ago is not read again by what it does now."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest
from django.db import connection
from django.test.utils import CaptureQueriesContext

from labweb.common.clock import now
from labweb.crutd import services
from labweb.crutd.models import ResourceLock
from labweb.domain.crutd.operations import Read
from labweb.resources.models import Resource
from tests.builders import Bench

pytestmark = pytest.mark.django_db

PAST = 5_000


def nodes(plan: dict[str, Any]) -> Iterator[dict[str, Any]]:
    yield plan
    for part in plan.get("Plans", []):
        yield from nodes(part)


def rows_read(query: str) -> int:
    """Return how many rows PostgreSQL looks at for a query, used or not."""
    with connection.cursor() as cursor:
        cursor.execute(f"EXPLAIN (ANALYZE, FORMAT JSON) {query}")
        (told,) = cursor.fetchone()
    plan = (json.loads(told) if isinstance(told, str) else told)[0]["Plan"]
    return sum(
        (node["Actual Rows"] + node.get("Rows Removed by Filter", 0)) * node["Actual Loops"]
        for node in nodes(plan)
    )


def test_locks_that_were_released_are_not_looked_at(bench: Bench) -> None:
    """Every transaction locks the root in intention: its locks are the longest history of all."""
    pump, root = bench.node("pump_1"), Resource.objects.get(lab=bench.lab, parent=None)
    first = services.lock_operation(
        Read(device_id=pump.id), lab=bench.lab, targets=[], actor_id=None
    )
    ResourceLock.objects.update(released_at=now())
    ResourceLock.objects.bulk_create(
        ResourceLock(resource=node, mode=mode, transaction=first, taken_at=now(), released_at=now())
        for _ in range(PAST)
        for node, mode in ((root, "IX"), (pump, "X"))
    )
    with connection.cursor() as cursor:
        cursor.execute("ANALYZE crutd_resourcelock")
    with CaptureQueriesContext(connection) as queries:
        services.lock_operation(Read(device_id=pump.id), lab=bench.lab, targets=[], actor_id=None)
    asked = [one["sql"] for one in queries if "crutd_resourcelock" in one["sql"]]
    looked = [sql for sql in asked if "INSERT" not in sql]
    assert looked
    assert max(rows_read(sql) for sql in looked) < PAST / 10
