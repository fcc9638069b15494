"""What is told of samples: frames that fit, and gaps that are known."""

from __future__ import annotations

from labweb.domain.messages.frames import MAX_FRAME_BYTES
from labweb.domain.messages.telemetry import MAX_SAMPLES_PER_FRAME
from workers.base.valkey_store import (
    LONGEST_STREAM_COUNT,
    MOST_SAMPLES_PER_BATCH,
    STREAM,
    SampleBatch,
    StatusSample,
    ValkeyStore,
)
from workers.uplink.sample_delivery import NOTHING, StreamPosition, is_reached, make_frame, parts_of


def a_batch(
    taken_count: int,
    at_s: float,
    *,
    count: int = 1,
    began_s: float = 10.0,
    size_bytes: int | None = None,
) -> SampleBatch:
    return SampleBatch(
        key=f"{int(at_s)}-0",
        line="a",
        samples=[StatusSample("d", "s", at_s + place, 0.0, 1.0) for place in range(count)],
        taken_count=taken_count,
        began_s=began_s,
        size_bytes=50 * count if size_bytes is None else size_bytes,
    )


def gaps_of(*batches: SampleBatch) -> list[tuple[float, float, int | None, str]]:
    _, frame = make_frame(StreamPosition(), list(batches), 1)
    return [(one.since_s, one.until_s, one.lost_count, one.reason) for one in frame.gaps]


def test_a_line_that_lost_nothing_has_no_gap() -> None:
    assert gaps_of(a_batch(2, 20.0, count=2), a_batch(3, 30.0)) == []


def test_what_was_lost_is_counted_from_the_begin_of_the_process() -> None:
    assert gaps_of(a_batch(5, 20.0)) == [(10.0, 20.0, 4, "overflow")]
    assert gaps_of(a_batch(1, 20.0), a_batch(9, 30.0, count=3)) == [(20.0, 30.0, 5, "overflow")]


def test_of_the_end_of_a_process_nobody_knows() -> None:
    found = gaps_of(a_batch(1, 20.0), a_batch(4, 50.0, began_s=40.0))
    assert found == [(20.0, 40.0, None, "restart"), (40.0, 50.0, 3, "overflow")]


def test_a_process_that_does_not_tell_its_begin_was_there_before() -> None:
    found = gaps_of(a_batch(700, 20.0, began_s=0.0), a_batch(703, 30.0, began_s=0.0))
    assert found == [(20.0, 30.0, 2, "overflow")]


def test_a_batch_that_no_frame_may_hold_is_a_gap_and_the_next_is_told() -> None:
    large = a_batch(1, 20.0, size_bytes=MAX_FRAME_BYTES + 1)
    told, frame = make_frame(StreamPosition(), [large, a_batch(2, 30.0)], 1)
    assert [one.reason for one in frame.gaps] == ["too_large"]
    assert [one[2] for one in frame.samples] == [30.0]
    assert told.key == frame.key == "30-0"


def test_frames_keep_their_bounds_and_their_order() -> None:
    batches = [a_batch(place, float(place), count=60) for place in range(200)]
    batches[7] = a_batch(7, 7.0, size_bytes=MAX_FRAME_BYTES)
    parts = list(parts_of(batches))
    assert [one for part in parts for one in part] == batches
    for part in parts:
        assert sum(len(one.samples) for one in part) <= MAX_SAMPLES_PER_FRAME
        assert sum(one.size_bytes for one in part) <= MAX_FRAME_BYTES
    assert list(parts_of([])) == []


def test_places_in_a_stream_are_compared_as_numbers() -> None:
    assert is_reached("9-2", "10-0")
    assert is_reached("9-2", "9-10")
    assert not is_reached("9-10", "9-2")
    assert is_reached(NOTHING, NOTHING)


def test_a_large_batch_goes_into_the_stream_in_parts_that_are_counted(store: ValkeyStore) -> None:
    samples = [StatusSample("d", f"s{place}", 7.0, 1.0, place) for place in range(150)]
    assert store.put("a", samples, 1150, 5.0)
    batches = store.batches(NOTHING, wait_s=0.1)
    assert [len(one.samples) for one in batches] == [64, 64, 22]
    assert [one.taken_count for one in batches] == [1064, 1128, 1150]
    assert {one.began_s for one in batches} == {5.0}
    assert all(one.size_bytes > 0 for one in batches)
    assert gaps_of(*batches) == [(5.0, 7.0, 1000, "overflow")]


def test_the_stream_is_bounded_while_the_server_is_away(store: ValkeyStore) -> None:
    sample = [StatusSample("d", "s", 1.0, 1.0, 1.0)]
    for place in range(LONGEST_STREAM_COUNT + 500):
        store.put("a", sample, place + 1)
    assert store._redis.xlen(STREAM) <= LONGEST_STREAM_COUNT + 200
    assert MOST_SAMPLES_PER_BATCH * LONGEST_STREAM_COUNT < 10**6
