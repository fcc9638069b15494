"""Whose work waits while a host is away.

run 1:  0 (A) ──▶ 1 (A) ──▶ 2 (B) ──▶ 3 (B)        job 4 (B) stands alone
"""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from uuid import UUID

import pytest

from labweb.domain.messages.commands import Cancel
from labweb.domain.runs.dispatch.command_outbox import is_due, stamped
from labweb.domain.runs.dispatch.job_scheduler import JobView
from labweb.domain.runs.dispatch.work_of_absent_host import find_waiting
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.domain.runs.states.job_states import JobState

A, B = UUID(int=1), UUID(int=2)
AT = datetime(2026, 1, 1, tzinfo=UTC)


def jobs(*states: str) -> list[JobView]:
    plan = ((A, ()), (A, (0,)), (B, (1,)), (B, (2,)), (B, ()))
    return [
        JobView(
            id=UUID(int=100 + index),
            index=index,
            state=JobState(state),
            after=after,
            host_id=host,
        )
        for index, ((host, after), state) in enumerate(zip(plan, states, strict=True))
    ]


def indices(ids: tuple[UUID, ...]) -> list[int]:
    return [one.int - 100 for one in ids]


@pytest.mark.parametrize("state", ["isolated", "quarantined", "fenced", "revoked"])
def test_work_of_an_absent_host_and_what_follows_from_it_is_suspended(state: str) -> None:
    found = find_waiting(
        jobs("dispatched", "queued", "queued", "queued", "queued"),
        {A: SessionState(state), B: SessionState.ONLINE},
    )
    assert indices(found.suspend) == [1, 2, 3]
    assert found.release == ()


def test_what_is_finished_holds_nobody_back() -> None:
    found = find_waiting(
        jobs("complete", "complete", "queued", "queued", "queued"),
        {A: SessionState.ISOLATED, B: SessionState.ONLINE},
    )
    assert found.suspend == ()


def test_what_uses_a_thing_of_the_absent_host_is_suspended_too() -> None:
    made = jobs("complete", "complete", "complete", "complete", "queued")
    made[4] = replace(made[4], owner_ids=frozenset({A}))
    found = find_waiting(made, {A: SessionState.ISOLATED, B: SessionState.ONLINE})
    assert indices(found.suspend) == [4]


@pytest.mark.parametrize("state", ["suspect", "syncing"])
def test_a_host_that_hesitates_suspends_nothing_and_releases_nothing(state: str) -> None:
    states = {A: SessionState(state), B: SessionState.ONLINE}
    assert find_waiting(jobs(*["queued"] * 5), states).suspend == ()
    found = find_waiting(jobs(*["suspended"] * 5), states)
    assert indices(found.release) == [4]


def test_all_goes_back_into_the_queue_when_everybody_is_online() -> None:
    states = {A: SessionState.ONLINE, B: SessionState.ONLINE}
    found = find_waiting(jobs(*["suspended"] * 5), states)
    assert indices(found.release) == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(
    ("state", "ago_s", "due"),
    [
        ("online", None, True),
        ("online", 1.9, False),
        ("online", 2.0, True),
        ("syncing", None, False),
        ("isolated", 99.0, False),
    ],
)
def test_a_command_is_rung_only_to_a_host_that_is_online(
    state: str, ago_s: float | None, due: bool
) -> None:
    assert is_due(SessionState(state), ago_s) is due


def test_a_command_is_sent_under_the_epoch_of_the_present_session() -> None:
    command = Cancel(host_id=A, epoch=1, dseq=4, action_id=B)
    assert stamped(command, 6, at=AT) == Cancel(host_id=A, epoch=6, dseq=4, action_id=B)
