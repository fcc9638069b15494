"""The newest value of a status, whatever else the devices have told."""

from __future__ import annotations

from uuid import UUID

from labweb.common.database.prepared_queries import together
from labweb.telemetry import selectors
from labweb.telemetry.models import Sample
from tests.builders import Bench


def _tell(device_id: UUID, status: str, at: float, value: object) -> None:
    Sample.objects.create(device_id=device_id, status=status, at=at, value=value)


def test_the_newest_value_of_each_device_that_told_it(bench: Bench) -> None:
    first, second = bench.device("pump_1"), bench.device("pump_2")
    for at, value in ((3.0, False), (1.0, True), (2.0, True)):
        _tell(first.id, "is_initialized", at, value)
    _tell(first.id, "position_ul", 9.0, 12.5)
    _tell(second.id, "position_ul", 9.0, 1.5)
    asked = ("is_initialized", "position_ul")
    initialized, positions = map(
        dict, together(*(selectors.asking_latest_in(bench.lab.pk, one) for one in asked))
    )
    assert initialized == {first.id: False}
    assert positions == {first.id: 12.5, second.id: 1.5}
