"""A time is when it happened, and the stated uncertainty covers what really was."""

from __future__ import annotations

from dataclasses import dataclass
from uuid import UUID

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.messages.events import EdgeEvent, event_hash
from labweb.domain.runs.host_journal.host_moment import HostMoment
from labweb.domain.runs.host_link.host_clocks import (
    DRIFT_RATIO,
    MOST_ANCHORS,
    Cause,
    ClockAnchor,
    Estimate,
    Exchange,
    anchor_of,
    best_of,
    dated,
    estimate,
    happened,
    latest,
    told_moment,
    with_anchor,
)

NIGHT_S = 40_000.0
CLOSE_S = 1e-4


@dataclass(frozen=True)
class Machine:
    """A host as an onlooker knows it: true time in, its clocks out."""

    ahead_s: float
    rate: float
    boot_id: str = "boot"

    def at(self, true_s: float, *, set_by_s: float = 0.0) -> HostMoment:
        mono_s = 500.0 + true_s * self.rate
        wall_s = true_s + self.ahead_s + set_by_s
        return HostMoment(boot_id=self.boot_id, mono_s=mono_s, wall_s=wall_s)

    def measures(self, true_s: float, there_s: float, works_s: float, back_s: float) -> ClockAnchor:
        asked = self.at(true_s)
        heard_at_s = true_s + there_s
        got = self.at(heard_at_s + works_s + back_s)
        found = anchor_of(
            Exchange(
                asked=asked,
                heard_at_s=heard_at_s,
                told_at_s=heard_at_s + works_s,
                got_mono_s=got.mono_s,
            )
        )
        assert found is not None
        return found


machines = st.builds(
    Machine,
    ahead_s=st.floats(-86_400, 86_400),
    rate=st.floats(1 - 0.9 * DRIFT_RATIO, 1 + 0.9 * DRIFT_RATIO),
)
ways = st.tuples(st.floats(0, 5), st.floats(0, 2), st.floats(0, 5))
times = st.floats(0, NIGHT_S)


@given(
    machines, st.lists(st.tuples(times, ways), min_size=1, max_size=6), times, st.floats(-9e4, 9e4)
)
def test_what_really_was_lies_within_the_stated_uncertainty(
    machine: Machine,
    measured: list[tuple[float, tuple[float, float, float]]],
    true_s: float,
    set_by_s: float,
) -> None:
    anchors: tuple[ClockAnchor, ...] = ()
    for at_s, way in measured:
        anchors = with_anchor(anchors, machine.measures(at_s, *way))
    found = estimate(anchors, machine.at(true_s, set_by_s=set_by_s))
    assert found.uncertainty_s is not None
    assert abs(found.at_s - true_s) <= found.uncertainty_s + CLOSE_S


@given(machines, times, ways, ways)
def test_the_shorter_way_wins(
    machine: Machine, at_s: float, one: tuple[float, ...], two: tuple[float, ...]
) -> None:
    first, second = machine.measures(at_s, *one), machine.measures(at_s, *two)
    best = best_of([first, second], machine.at(at_s))
    assert best is not None
    assert best.error_s <= max(first.error_s, second.error_s)
    now = machine.at(at_s)
    sure = [estimate([one], now).uncertainty_s or 0.0 for one in (first, second)]
    assert estimate([first, second], now).uncertainty_s == min(sure)


@given(machines, st.lists(st.tuples(times, ways), min_size=MOST_ANCHORS, max_size=90))
def test_measures_that_are_kept_are_few_and_the_newest_counts(
    machine: Machine, measured: list[tuple[float, tuple[float, float, float]]]
) -> None:
    anchors: tuple[ClockAnchor, ...] = ()
    for at_s, way in sorted(measured):
        fresh = machine.measures(at_s, *way)
        before = estimate(anchors, machine.at(at_s)).uncertainty_s
        anchors = with_anchor(anchors, fresh)
        after = estimate(anchors, machine.at(at_s)).uncertainty_s
        assert after is not None
        assert after <= (estimate([fresh], machine.at(at_s)).uncertainty_s or 0.0) + 1e-9
        assert before is None or after <= before + 1e-9
    assert len(anchors) <= MOST_ANCHORS


def test_a_measure_of_a_night_ago_is_kept_beside_many_new_ones() -> None:
    machine = Machine(ahead_s=0.0, rate=1.0)
    anchors: tuple[ClockAnchor, ...] = ()
    for at_s in (0.0, *(NIGHT_S + i for i in range(3000))):
        anchors = with_anchor(anchors, machine.measures(at_s, 0.001, 0.0, 0.001))
    found = estimate(anchors, machine.at(10.0))
    assert found.uncertainty_s is not None
    assert found.uncertainty_s < 0.01


@pytest.mark.parametrize(
    ("heard_at_s", "told_at_s"), [(86_400.0, 0.5), (1.0, 500.0)], ids=["back", "forward"]
)
def test_a_clock_that_is_set_in_an_exchange_measures_nothing(
    heard_at_s: float, told_at_s: float
) -> None:
    asked = HostMoment(boot_id="boot", mono_s=0.0, wall_s=0.0)
    exchange = Exchange(asked=asked, heard_at_s=heard_at_s, told_at_s=told_at_s, got_mono_s=1.0)
    assert anchor_of(exchange) is None


def test_a_start_without_a_measure_is_believed_and_nobody_knows_how_wrong_it_is() -> None:
    anchor = Machine(ahead_s=3600.0, rate=1.0).measures(0.0, 0.1, 0.0, 0.1)
    other = HostMoment(boot_id="another", mono_s=5.0, wall_s=3700.0)
    found = estimate([anchor], other)
    assert found.uncertainty_s is None
    assert found.at_s == pytest.approx(100.0)
    assert estimate([], other) == Estimate(3700.0, None)


estimates = st.builds(Estimate, st.floats(-1e5, 1e5), st.none() | st.floats(0, 100))
causes = st.lists(st.builds(Cause, st.floats(-1e5, 1e5), st.floats(0, 100)), min_size=1, max_size=3)


@given(estimates, causes, st.floats(0, 1e5))
def test_nothing_is_before_its_cause_nor_after_its_reception(
    told: Estimate, before: list[Cause], waited_s: float
) -> None:
    last_s = max(one.at_s for one in before)
    found = happened(told, before, last_s + waited_s)
    assert last_s <= found.at_s <= last_s + waited_s


@given(estimates, causes, st.floats(-1e5, 1e5))
def test_a_server_whose_own_clock_was_set_back_keeps_the_order(
    told: Estimate, before: list[Cause], by_s: float
) -> None:
    found = happened(told, before, by_s)
    assert found.at_s >= max(one.at_s for one in before)
    assert found.uncertainty_s >= found.at_s - by_s


@given(
    st.floats(0, 1000), st.floats(-50, 50), st.floats(0, 50), st.floats(0, 1000), st.floats(0, 1000)
)
def test_the_uncertainty_covers_what_really_was_wherever_the_bounds_moved_it(
    true_s: float, off_s: float, cause_off_s: float, ago_s: float, waited_s: float
) -> None:
    told = Estimate(true_s + off_s, abs(off_s) + 1e-6)
    cause = Cause(min(true_s - ago_s + cause_off_s, true_s + waited_s), cause_off_s + 1e-6)
    found = happened(told, [cause], true_s + waited_s)
    assert abs(found.at_s - true_s) <= found.uncertainty_s + 1e-9
    assert not found.is_bounded


def test_a_clock_that_contradicts_cause_and_reception_is_flagged_and_widened() -> None:
    found = happened(Estimate(500.0, 0.01), [Cause(1000.0)], 1060.0)
    assert (found.at_s, found.uncertainty_s, found.is_bounded) == (1000.0, 60.0, True)
    unmeasured = happened(Estimate(1020.0, None), [Cause(1000.0)], 1060.0)
    assert (unmeasured.at_s, unmeasured.uncertainty_s, unmeasured.is_bounded) == (1020, 40, True)


def an_event(**fields: object) -> EdgeEvent:
    plain = {"seq": 1, "prev_hash": "", "hash": "", "kind": "boot", "action_id": None}
    return EdgeEvent(**plain, at_s=7.0, body={}, **fields)  # type: ignore[arg-type]


def test_a_later_event_bounds_the_ones_before_it() -> None:
    vague, sure = an_event(), an_event(happened_s=100.0, uncertainty_s=0.5)
    assert latest([vague, sure, vague], 900.0) == [100.5, 100.5, 900.0]


def test_an_event_of_an_older_program_is_bound_as_it_was_and_a_new_one_with_its_clocks() -> None:
    journal = UUID(int=1)
    old = an_event()
    assert event_hash(journal, "", old) == (
        "a7565905582a33f515df7df062492b94eafd1916943e30ada2a8650e30b40657"
    )
    new = an_event(mono_s=3.0, boot_id="boot")
    later = an_event(mono_s=4.0, boot_id="boot")
    assert len({event_hash(journal, "", one) for one in (old, new, later)}) == 3
    # What the host knows of the server's clock when it tells is no part of what it wrote.
    told = dated(new, [Machine(0.0, 1.0).measures(0.0, 0.1, 0.0, 0.1)])
    assert told.happened_s is not None
    assert event_hash(journal, "", told) == event_hash(journal, "", new)
    assert dated(old, []) == old
    assert told_moment(old) == Estimate(7.0, None)
