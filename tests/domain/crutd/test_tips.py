"""Tips as vessels: mounted, drawn into, given out of, put away.

rack ── spot_1 ── tip_1        plate ── source, target        channel
     └─ spot_2 ── tip_2
"""

from __future__ import annotations

from collections.abc import Callable
from uuid import UUID, uuid5

import pytest

from labweb.domain.crutd import pipette_tips
from labweb.domain.errors import PreconditionError
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import KINDS
from tests.domain.crutd.pipetting import CHANNEL, Record


def an_id(key: str) -> UUID:
    return uuid5(UUID(int=1), key)


def a_row(
    key: str, kind: str, parent: str | None = None, capacity_ul: int | None = None
) -> Resource:
    return Resource(
        id=an_id(key),
        key=key,
        name=key,
        kind=kind,
        nature=KINDS[kind].nature,
        parent_id=None if parent is None else an_id(parent),
        config={} if capacity_ul is None else {"capacity_ul": capacity_ul},
    )


@pytest.fixture
def bench() -> Record:
    rows = [a_row("rack", "tip_rack"), a_row("plate", "plate"), a_row("waste", "waste")]
    for n in (1, 2):
        rows.append(a_row(f"spot_{n}", "tip_spot", "rack"))
        rows.append(a_row(f"tip_{n}", "tip", f"spot_{n}", 300))
    rows += [a_row(key, "well", "plate", 360) for key in ("source", "target")]
    record = Record.of(rows)
    record.fill(an_id("source"), 200_000)
    record.fill(an_id("target"), 350_000)
    return record


def refused(act: Callable[..., object], *args: object, **options: object) -> list[str]:
    with pytest.raises(PreconditionError) as error:
        act(*args, **options)
    assert error.value.code == error.value.findings[0].code
    return [finding.code for finding in error.value.findings]


def test_liquid_goes_from_well_to_tip_to_well_and_none_is_lost(bench: Record) -> None:
    before = bench.total_nl()
    bench.carry_out(pipette_tips.mount(an_id("spot_1"), CHANNEL, bench.states))
    bench.carry_out(pipette_tips.draw(CHANNEL, an_id("source"), 30_000, bench.states))
    assert bench.held_nl(an_id("tip_1")) == 30_000
    bench.carry_out(pipette_tips.give(CHANNEL, an_id("target"), 10_000, bench.states))
    assert bench.held_nl(an_id("target")) == 360_000
    assert bench.total_nl() == before


def test_nothing_is_drawn_or_given_without_a_tip(bench: Record) -> None:
    assert refused(pipette_tips.draw, CHANNEL, an_id("source"), 1, bench.states) == ["crutd.no_tip"]
    assert refused(pipette_tips.give, CHANNEL, an_id("target"), 1, bench.states) == ["crutd.no_tip"]
    assert refused(pipette_tips.put_away, CHANNEL, an_id("spot_1"), bench.states) == [
        "crutd.no_tip"
    ]


def test_a_channel_takes_one_tip(bench: Record) -> None:
    bench.carry_out(pipette_tips.mount(an_id("spot_1"), CHANNEL, bench.states))
    assert refused(pipette_tips.mount, an_id("spot_2"), CHANNEL, bench.states) == ["crutd.has_tip"]
    both = refused(pipette_tips.mount, an_id("spot_1"), CHANNEL, bench.states)
    assert both == ["crutd.has_tip", "crutd.no_tip"]


def test_a_spot_takes_one_tip(bench: Record) -> None:
    bench.carry_out(pipette_tips.mount(an_id("spot_1"), CHANNEL, bench.states))
    assert refused(pipette_tips.put_away, CHANNEL, an_id("spot_2"), bench.states) == [
        "crutd.has_tip"
    ]
    bench.carry_out(pipette_tips.put_away(CHANNEL, an_id("spot_1"), bench.states))
    assert bench.tip is None


def test_a_tip_that_holds_liquid_is_put_away_only_if_a_person_agrees(bench: Record) -> None:
    bench.carry_out(pipette_tips.mount(an_id("spot_1"), CHANNEL, bench.states))
    bench.carry_out(pipette_tips.draw(CHANNEL, an_id("source"), 50_000, bench.states))
    spot = an_id("spot_1")
    assert refused(pipette_tips.put_away, CHANNEL, spot, bench.states) == ["crutd.tip_holds_liquid"]
    before = bench.total_nl()
    bench.carry_out(pipette_tips.put_away(CHANNEL, spot, bench.states, may_hold_liquid=True))
    assert bench.tip is None
    assert bench.held_nl(an_id("tip_1")) == 50_000
    assert bench.total_nl() == before


def test_a_draw_is_refused_for_the_well_and_for_the_tip_at_once(bench: Record) -> None:
    bench.carry_out(pipette_tips.mount(an_id("spot_1"), CHANNEL, bench.states))
    codes = refused(pipette_tips.draw, CHANNEL, an_id("source"), 301_000, bench.states)
    assert codes == ["crutd.insufficient_volume", "crutd.capacity_exceeded"]


def test_a_tip_is_not_put_where_nothing_can_stand(bench: Record) -> None:
    bench.carry_out(pipette_tips.mount(an_id("spot_1"), CHANNEL, bench.states))
    assert refused(pipette_tips.put_away, CHANNEL, an_id("source"), bench.states) == [
        "crutd.no_place"
    ]
