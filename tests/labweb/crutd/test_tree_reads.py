"""What lies below a node, whether it is a plate or the whole lab."""

from __future__ import annotations

from django.db import connection
from django.test.utils import CaptureQueriesContext

from labweb.resources.models import Resource
from labweb.resources.selectors import descendants
from tests.builders import Bench


def fill(bench: Bench, key: str, count: int) -> Resource:
    """Put a plate with so many wells on the bench."""
    common = {"lab": bench.lab, "nature": "resource"}
    plate = Resource.objects.create(
        parent=bench.node("bench_1"), key=key, name=key, kind="plate", **common
    )
    Resource.objects.bulk_create(
        Resource(parent=plate, key=f"{key}/{n}", name=str(n), kind="well", **common)
        for n in range(count)
    )
    return plate


def test_below_a_few_or_many_is_everything_and_nothing_else(bench: Bench) -> None:
    small, large = fill(bench, "small", 96), fill(bench, "large", 700)
    for plate, count in ((small, 97), (large, 701)):
        below = set(Resource.objects.filter(parent=plate).values_list("id", flat=True))
        assert descendants([plate.id]) == below | {plate.id}
        assert len(below) == count - 1
    root = Resource.objects.get(lab=bench.lab, parent=None)
    assert descendants([root.id]) == set(Resource.objects.values_list("id", flat=True))


def test_roots_that_lie_in_each_other_hide_nothing(bench: Bench) -> None:
    # More rows come than there are nodes: each well by itself, and again below its plate.
    plate, other = fill(bench, "plate", 300), fill(bench, "other", 250)
    wells = Resource.objects.filter(parent__in=[plate, other]).values_list("id", flat=True)
    found = descendants([plate.id, *wells, other.id])
    assert found == {plate.id, other.id, *wells}


def test_a_plate_is_one_query(bench: Bench) -> None:
    plate = fill(bench, "plate", 384)
    with CaptureQueriesContext(connection) as queries:
        assert len(descendants([plate.id])) == 385
    assert len(queries) == 1
