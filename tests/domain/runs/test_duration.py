"""What goes on at the same time is not added up."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.runs.dispatch.job_duration import JobSpan, span_s


def part(index: int, takes_s: float, *after: int, device: str = "") -> JobSpan:
    return JobSpan(index=index, after=after, device=device or f"d{index}", takes_s=takes_s)


def test_jobs_on_two_devices_take_as_long_as_the_longer() -> None:
    assert span_s([part(0, 30.0), part(1, 50.0)]) == 50.0


def test_jobs_of_one_device_take_turns() -> None:
    assert span_s([part(0, 30.0, device="pump"), part(1, 50.0, device="pump")]) == 80.0


def test_a_job_waits_for_all_that_it_comes_after() -> None:
    assert span_s([part(2, 5.0, 0, 1), part(0, 30.0), part(1, 50.0)]) == 55.0


def test_what_is_not_listed_has_ended() -> None:
    assert span_s([part(3, 5.0, 0, 1)]) == 5.0
    assert span_s([]) == 0.0


@st.composite
def jobs(draw: st.DrawFn) -> list[JobSpan]:
    found = []
    for index in range(draw(st.integers(1, 12))):
        after = draw(st.sets(st.integers(0, index - 1))) if index else set()
        device = draw(st.sampled_from(["a", "b", "c"]))
        takes_s = float(draw(st.integers(0, 100)))
        found.append(JobSpan(index=index, after=after, device=device, takes_s=takes_s))
    return found


@given(jobs())
def test_it_lies_between_the_busiest_device_and_the_sum(parts: list[JobSpan]) -> None:
    busy = {one.device: 0.0 for one in parts}
    for one in parts:
        busy[one.device] += one.takes_s
    assert max(busy.values()) <= span_s(parts) <= sum(busy.values())
