"""Places of a lane: so many in all and of one name, in the order of asking."""

from __future__ import annotations

import asyncio

import pytest

from labweb.common.limits.concurrency import FullError, Lane, LaneTicket, Room


async def entered(lane: Lane, *names: str) -> None:
    for name in names:
        await lane.enter(name)


async def test_who_is_one_too_many_of_its_own_leaves_the_rest_to_others() -> None:
    lane = Lane(Room(most=3, most_of_one=2))
    await entered(lane, "a", "a")
    with pytest.raises(FullError) as refused:
        await lane.enter("a")
    assert refused.value.is_own
    await lane.enter("b")
    with pytest.raises(FullError) as refused:
        await lane.enter("c")
    assert not refused.value.is_own


async def test_a_place_goes_to_the_first_who_may_have_it() -> None:
    lane = Lane(Room(most=2, most_of_one=1, waits_s=5))
    await entered(lane, "a", "b")
    order: list[str] = []

    async def wait(name: str) -> None:
        await lane.enter(name)
        order.append(name)

    waiting = []
    for name in ("b", "a", "c"):
        waiting.append(asyncio.create_task(wait(name)))
        await asyncio.sleep(0)
    lane.leave("a")
    await asyncio.sleep(0.01)
    assert order == ["a"]  # the other place is b's own already
    lane.leave("b")
    await asyncio.sleep(0.01)
    assert order == ["a", "b"]
    lane.leave("b")
    await asyncio.gather(*waiting)
    assert order == ["a", "b", "c"]


async def test_patience_has_an_end_and_leaves_nothing_behind() -> None:
    lane = Lane(Room(most=1, most_of_one=1, waits_s=0.02))
    await lane.enter("a")
    with pytest.raises(FullError):
        await lane.enter("b")
    lane.leave("a")
    await lane.enter("b")
    lane.leave("b")
    await lane.enter("a")


async def test_who_stops_waiting_takes_no_place() -> None:
    lane = Lane(Room(most=1, most_of_one=1, waits_s=5))
    await lane.enter("a")
    gone = asyncio.create_task(lane.enter("b"))
    await asyncio.sleep(0)
    lane.leave("a")  # its turn has come, and in the same moment it gives up
    gone.cancel()
    with pytest.raises(asyncio.CancelledError):
        await gone
    await asyncio.wait_for(lane.enter("c"), 1)


async def test_a_queue_has_an_end() -> None:
    lane = Lane(Room(most=1, most_of_one=1, waits_s=5, most_waiting=2, most_waiting_of_one=1))
    await lane.enter("a")
    waiting = [asyncio.create_task(lane.enter(name)) for name in ("b", "c")]
    await asyncio.sleep(0)
    for name, is_own in (("b", True), ("d", False)):
        with pytest.raises(FullError) as refused:
            await lane.enter(name)
        assert refused.value.is_own is is_own
    for task in waiting:
        task.cancel()


async def test_a_place_is_free_when_its_thread_is_and_not_when_nobody_listens_any_more() -> None:
    lane = Lane(Room(most=1, most_of_one=1))
    await lane.enter("a")
    ticket = LaneTicket(lane, "a")
    assert ticket.begin()
    ticket.drop()
    with pytest.raises(FullError):
        await lane.enter("b")
    await asyncio.to_thread(ticket.end)
    await asyncio.sleep(0.01)
    await lane.enter("b")


async def test_a_thread_that_comes_too_late_does_not_begin() -> None:
    lane = Lane(Room(most=1, most_of_one=1))
    await lane.enter("a")
    ticket = LaneTicket(lane, "a")
    ticket.drop()
    assert not ticket.begin()
    await lane.enter("b")
