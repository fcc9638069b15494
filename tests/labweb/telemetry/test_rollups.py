"""Samples become buckets of seconds, minutes and hours, whichever way they come."""

from __future__ import annotations

import random
import time
from collections.abc import Sequence
from statistics import fmean
from typing import Any
from uuid import UUID, uuid4

import pytest
from pytest_django import Settings

from labweb.domain.messages.telemetry import TelemetryGap
from labweb.domain.telemetry_resolution import LEVELS_S, MOST_POINTS
from labweb.telemetry import selectors, services
from labweb.telemetry.models import Gap, Mark, Rollup, Sample
from labweb.telemetry.services import roll_ups
from tests.builders import Bench

Told = tuple[str, str, float, Any]


@pytest.fixture
def device_id(bench: Bench) -> UUID:
    return bench.device("pump_1").id


@pytest.fixture
def begin(monkeypatch: pytest.MonkeyPatch) -> float:
    """The begin of an hour not long ago; every level is computed as soon as it is asked for."""
    monkeypatch.setattr(roll_ups, "_WAIT_S", dict.fromkeys(LEVELS_S, 0.0))
    return float(int(time.time() - 7200) // 3600 * 3600)


def a_stream(device_id: UUID, begin: float, count: int, every_s: float = 0.5) -> list[Told]:
    values = random.Random(7)
    return [
        (str(device_id), "temperature_c", begin + place * every_s, values.gauss(20.0, 3.0))
        for place in range(count)
    ]


def roll_up() -> None:
    while services.roll_up(budget_s=10.0):
        continue


def wanted(stream: Sequence[Told], level: int) -> dict[float, list[float]]:
    buckets: dict[float, list[float]] = {}
    for _, _, at, value in stream:
        buckets.setdefault(at // level * level, []).append(value)
    return buckets


def assert_rolled_up(stream: Sequence[Told]) -> None:
    for level in LEVELS_S:
        told = wanted(stream, level)
        rows = Rollup.objects.filter(level_s=level)
        assert {row.at for row in rows} == set(told)
        for row in rows:
            values = told[row.at]
            assert (row.low, row.high, row.count) == (min(values), max(values), len(values))
            assert row.mean == pytest.approx(fmean(values))


def test_a_batch_becomes_buckets_of_every_level(device_id: UUID, begin: float) -> None:
    stream = a_stream(device_id, begin, 300)
    services.take_in({device_id}, stream)
    roll_up()
    assert_rolled_up(stream)
    assert not Mark.objects.exists()


def test_batches_that_come_late_twice_or_out_of_order_give_the_same_buckets(
    device_id: UUID, begin: float
) -> None:
    stream = a_stream(device_id, begin, 300)
    parts = [stream[place : place + 40] for place in range(0, 300, 40)]
    order = [*parts, *parts[2:5], parts[0]]
    random.Random(3).shuffle(order)
    for part in order:
        services.take_in({device_id}, part)
        services.roll_up(budget_s=10.0)
    roll_up()
    assert_rolled_up(stream)
    assert Sample.objects.count() == len(stream)


def test_a_batch_that_comes_twice_marks_nothing(device_id: UUID, begin: float) -> None:
    stream = a_stream(device_id, begin, 20)
    services.take_in({device_id}, stream)
    roll_up()
    services.take_in({device_id}, stream)
    assert not Mark.objects.exists()
    other = [(*stream[0][:3], -500.0)]
    services.take_in({device_id}, other)
    assert not Mark.objects.exists()
    assert_rolled_up(stream)


def test_what_is_neither_number_nor_yes_or_no_is_kept_and_rolled_up_into_nothing(
    device_id: UUID, begin: float
) -> None:
    for place, value in enumerate(("idle", "true", {"a": [1]}, None)):
        services.take_in({device_id}, [(str(device_id), "mode", begin + place, value)])
    roll_up()
    assert Sample.objects.count() == 4
    assert not Rollup.objects.exists()


def test_a_gap_that_a_host_tells_is_kept_once(device_id: UUID, begin: float) -> None:
    gap = TelemetryGap(
        device_ids=[str(device_id), str(uuid4()), "nobody"],
        since_s=begin,
        until_s=begin + 9,
        lost_count=12,
        reason="overflow",
    )
    for _ in range(2):
        services.take_in({device_id}, [], [gap])
    told = {"since": begin, "until": begin + 9, "lost_count": 12, "reason": "overflow"}
    assert selectors.gaps(device_id, begin + 3, begin + 4) == [told]
    assert selectors.gaps(device_id, begin + 10, begin + 20) == []
    assert Gap.objects.count() == 1


@pytest.mark.parametrize(
    ("status", "ago_s", "value", "reason"),
    [
        ("x" * 65, 5.0, 1.0, "refused"),
        ("", 5.0, 1.0, "refused"),
        ("a\0b", 5.0, 1.0, "refused"),
        ("mode", 5.0, "a\0b", "refused"),
        ("mode", -2 * 86400.0, 1.0, "refused"),
        ("mode", 2 * 86400.0, 1.0, "late"),
    ],
)
def test_a_sample_that_cannot_be_stored_leaves_a_gap_and_spares_the_others(
    device_id: UUID, status: str, ago_s: float, value: object, reason: str
) -> None:
    at = time.time()
    good = (str(device_id), "temperature_c", at, 20.0)
    services.take_in({device_id}, [(str(device_id), status, at - ago_s, value), good])
    assert Sample.objects.get().at == at
    gap = Gap.objects.get()
    assert (gap.reason, gap.lost_count, gap.since) == (reason, 1, at - ago_s)


def test_samples_of_devices_of_another_host_are_dropped(device_id: UUID, begin: float) -> None:
    services.take_in({uuid4()}, a_stream(device_id, begin, 3))
    assert not Sample.objects.exists()


def test_each_level_is_trimmed_at_its_own_age(
    device_id: UUID, begin: float, settings: Settings
) -> None:
    stream = a_stream(device_id, begin, 40, every_s=60.0)
    services.take_in({device_id}, stream)
    roll_up()
    assert services.trim() == 0
    settings.TELEMETRY_KEEP_S = {0: -7200.0, 1: 1e6, 60: 1e6, 3600: 1e6}
    assert services.trim(most=30) == 30
    assert services.trim() == 10
    assert not Sample.objects.exists()
    assert_rolled_up(stream)
    settings.TELEMETRY_KEEP_S = {0: -7200.0, 1: -7200.0, 60: 1e6, 3600: 1e6}
    services.trim()
    assert set(Rollup.objects.values_list("level_s", flat=True)) == {60, 3600}


def test_samples_whose_buckets_wait_too_long_are_not_trimmed(
    device_id: UUID, begin: float, settings: Settings
) -> None:
    services.take_in({device_id}, a_stream(device_id, begin, 5))
    Mark.objects.update(due_at=begin)
    settings.TELEMETRY_KEEP_S = {0: -7200.0, 1: 1e6, 60: 1e6, 3600: 1e6}
    services.trim()
    assert Sample.objects.count() == 5


def test_no_curve_has_more_points_than_were_asked_for(device_id: UUID, begin: float) -> None:
    stream = a_stream(device_id, begin, 3000, every_s=1.0)
    services.take_in({device_id}, stream)
    roll_up()
    few = selectors.curves(device_id, begin, begin + 100, points=200)["temperature_c"]
    assert (few.level_s, few.step_s, len(few.points)) == (0, 0, 101)
    many = selectors.curves(device_id, begin, begin + 3000, points=200)["temperature_c"]
    assert (many.level_s, many.step_s) == (1, 15)
    assert len(many.points) == 200
    assert [point[0] for point in many.points[:2]] == [begin, begin + 15]
    values = [value for *_, value in stream[:15]]
    assert many.points[0][1:] == (pytest.approx(fmean(values)), min(values), max(values), 15)
    far = selectors.curves(device_id, 0, begin + 3000, points=200)["temperature_c"]
    assert (far.level_s, len(far.points)) == (3600, 1)
    assert sum(point[4] for point in far.points) == 3000


def test_the_series_of_old_is_bounded_too(device_id: UUID, begin: float) -> None:
    words = [(str(device_id), "mode", begin + place, str(place)) for place in range(2500)]
    services.take_in({device_id}, a_stream(device_id, begin, 2500, every_s=1.0))
    services.take_in({device_id}, words)
    roll_up()
    found = selectors.series(device_id, begin, begin + 2500)
    assert set(found) == {"mode", "temperature_c"}
    assert all(1000 < len(points) <= MOST_POINTS for points in found.values())
    assert selectors.series(device_id, begin, begin) == {}


def test_the_newest_of_each_status_is_found_without_reading_the_others(
    device_id: UUID, begin: float
) -> None:
    services.take_in({device_id}, a_stream(device_id, begin, 9))
    services.take_in({device_id}, [(str(device_id), "mode", begin, "idle")])
    found = selectors.latest([device_id, uuid4()])
    assert set(found) == {device_id}
    assert found[device_id]["mode"] == (begin, "idle")
    assert found[device_id]["temperature_c"][0] == begin + 4


def test_of_yes_or_no_a_bucket_tells_the_share_of_yes(device_id: UUID, begin: float) -> None:
    said = [place % 4 == 0 for place in range(480)]
    stream: list[Told] = [
        (str(device_id), "is_open", begin + place * 0.25, is_open)
        for place, is_open in enumerate(said)
    ]
    services.take_in({device_id}, stream)
    roll_up()
    assert_rolled_up([(*row[:3], float(row[3])) for row in stream])
    hour = Rollup.objects.get(level_s=3600)
    assert (hour.low, hour.high, hour.mean, hour.count) == (0.0, 1.0, 0.25, 480)


def test_what_never_changed_has_no_band(device_id: UUID, begin: float) -> None:
    stream: list[Told] = [(str(device_id), "is_open", begin + place, True) for place in range(90)]
    services.take_in({device_id}, stream)
    roll_up()
    assert {(row.low, row.high, row.mean) for row in Rollup.objects.all()} == {(1.0, 1.0, 1.0)}


def test_a_long_range_draws_the_share_and_a_text_stays_samples(
    device_id: UUID, begin: float
) -> None:
    stream: list[Told] = []
    for place in range(600):
        at = begin + place
        stream.append((str(device_id), "is_open", at, place < 300))
        stream.append((str(device_id), "mode", at, "RUNNING" if place % 2 else "IDLE"))
    services.take_in({device_id}, stream)
    roll_up()
    assert not Rollup.objects.filter(status="mode").exists()
    found = selectors.curves(device_id, begin, begin + 600, points=10)
    assert "mode" not in found, "it has more samples than fit, and no buckets"
    shares = [point[1] for point in found["is_open"].points]
    assert shares[:5] == [1.0] * 5
    assert shares[5:10] == [0.0] * 5
    samples = selectors.curves(device_id, begin, begin + 5, points=10)
    assert [value for _, value in samples["mode"].points[:2]] == ["IDLE", "RUNNING"]
