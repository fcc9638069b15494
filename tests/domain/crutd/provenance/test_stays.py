"""When a thing was at a place.

```text
bench ─┬─ heater ── rack ── vial        the rack is carried away with the vial, and back
       └─ shelf
```
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from datetime import UTC, datetime

from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.crutd.provenance.stays_at_places import PlaceMove, Stay, clipped, stays_at


def hour(number: int) -> datetime:
    return datetime(2026, 1, 1, number, tzinfo=UTC)


def asked(
    resource: str, place: str, moves: Sequence[PlaceMove], parents: Mapping[str, str | None]
) -> list[Stay]:
    seen: set[str] = set()

    def read(ids: Collection[str]) -> list[PlaceMove]:
        assert not seen & set(ids), "each resource is read once"
        seen.update(ids)
        return [move for move in moves if move.resource in ids]

    return stays_at(resource, [place], read, lambda ids: {n: parents.get(n) for n in ids})


PARENTS = {"vial": "rack", "rack": "heater", "heater": "bench", "shelf": "bench", "bench": None}


def test_what_never_moved_was_there_always() -> None:
    assert asked("vial", "heater", [], PARENTS) == [Stay(None, None)]
    assert asked("vial", "shelf", [], PARENTS) == []
    assert asked("heater", "heater", [], PARENTS) == [Stay(None, None)]


def test_a_vial_goes_with_its_rack() -> None:
    moves = [
        PlaceMove(hour(2), "rack", "heater", "shelf"),
        PlaceMove(hour(5), "rack", "shelf", "heater"),
    ]
    assert asked("vial", "heater", moves, PARENTS) == [Stay(None, hour(2)), Stay(hour(5), None)]
    assert asked("vial", "shelf", moves, PARENTS) == [Stay(hour(2), hour(5))]


def test_a_change_of_rack_inside_the_place_ends_no_stay() -> None:
    moves = [
        PlaceMove(hour(1), "vial", "shelf", "rack"),
        PlaceMove(hour(3), "vial", "rack", "heater"),
        PlaceMove(hour(4), "vial", "heater", "shelf"),
        PlaceMove(hour(6), "vial", "shelf", "rack"),
    ]
    assert asked("vial", "heater", moves, PARENTS) == [Stay(hour(1), hour(4)), Stay(hour(6), None)]


@given(
    st.lists(
        st.tuples(st.sampled_from(["vial", "rack"]), st.sampled_from(["heater", "shelf", "bench"])),
        max_size=12,
    )
)
def test_stays_are_what_a_watch_every_half_hour_would_see(steps: list[tuple[str, str]]) -> None:
    now: dict[str, str | None] = dict(PARENTS)
    moves, seen = [], []

    def is_in_heater() -> bool:
        node: str | None = "vial"
        while node is not None and node != "heater":
            node = now[node]
        return node == "heater"

    seen.append(is_in_heater())
    for number, (resource, place) in enumerate(steps, start=1):
        before = now[resource]
        assert before is not None
        moves.append(PlaceMove(hour(number), resource, before, place))
        now[resource] = place
        seen.append(is_in_heater())
    stays = asked("vial", "heater", moves, now)
    for number, was_there in enumerate(seen):
        at = datetime(2026, 1, 1, number, 30, tzinfo=UTC)
        found = [s for s in stays if (s.since or at) <= at and at < (s.until or hour(23))]
        assert bool(found) == was_there


def test_a_window_cuts_stays() -> None:
    stays = [Stay(None, hour(2)), Stay(hour(5), None)]
    assert clipped(stays, hour(1), hour(6)) == [(hour(1), hour(2)), (hour(5), hour(6))]
    assert clipped(stays, hour(3), hour(4)) == []
