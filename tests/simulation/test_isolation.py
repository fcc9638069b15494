"""I15: what goes wrong with one host changes nothing for another, neither state nor time."""

from __future__ import annotations

import os
from collections.abc import Sequence
from random import Random

import pytest

from labweb.domain.runs.dispatch import work_of_absent_host
from labweb.domain.runs.dispatch.job_scheduler import JobView
from labweb.domain.runs.states.job_states import FINAL
from tests.simulation import schedule
from tests.simulation.world import APART, World, add_jobs

WORK = tuple(schedule.WEIGHTS)[:7]
"""Line, exchange, broker, uplink, up, down, dispatcher."""

FAULTS = (
    schedule._cut_off,
    schedule._host_killed,
    schedule._host_rebooted,
    schedule._line_killed,
    schedule._link_cut,
    schedule._put_back,
    schedule._copied,
    schedule._row_lost,
    schedule._broker_purged,
)
STEPS = 400
COUNT = 5000 if os.environ.get("LABWEB_SOAK") else 150
History = list[tuple[float, int, str]]


def history_of_b(seed: int, *, is_a_faulty: bool) -> History:
    """Play one order of steps, with the faults of host A or without them."""
    rng = Random(seed)
    world = World(seed)
    add_jobs(world, APART)
    seen: dict[int, str] = {}
    history: History = []
    weights = [*list(schedule.WEIGHTS.values())[:7], 6, 3]
    for _ in range(STEPS):
        kind = rng.choices(range(9), weights=weights)[0]
        name, fault = rng.choice("AB"), rng.choice(FAULTS)
        world.now_s += 0.05
        if kind < len(WORK):
            WORK[kind](world, world.hosts[name])
        elif kind == 7:
            world.pass_time(4.0)
        elif is_a_faulty:
            fault(world, world.hosts["A"])
        for job in world.server.jobs:
            if job.host == "B" and seen.get(job.index) != job.state.value:
                seen[job.index] = job.state.value
                history.append((round(world.now_s, 3), job.index, job.state.value))
    return history


def play_both(seeds: range) -> list[int]:
    return [
        seed
        for seed in seeds
        if history_of_b(seed, is_a_faulty=True) != history_of_b(seed, is_a_faulty=False)
    ]


def test_the_faults_of_one_host_change_neither_state_nor_time_of_the_other_s_jobs() -> None:
    assert play_both(range(COUNT)) == []


def test_the_other_host_really_works_meanwhile() -> None:
    ended = [history for seed in range(20) if (history := history_of_b(seed, is_a_faulty=True))]
    final = {state.value for state in FINAL}
    assert sum(state in final for history in ended for _, _, state in history) > 20


def test_a_rule_that_suspends_everybody_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def everybody(jobs: Sequence[JobView], hosts: set[object]) -> set[int]:
        return {job.index for job in jobs} if hosts else set()

    monkeypatch.setattr(work_of_absent_host, "_reached", everybody)
    assert play_both(range(60))
