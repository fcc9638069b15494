"""What a halt takes away: of the record, and of what completed actions had begun."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any
from uuid import UUID

import pytest

from labweb.domain.runs.after_failure.recovery_choices import Ended, choices_for
from labweb.domain.runs.halts.device_motion import is_moving, tells_motion
from labweb.domain.runs.halts.halted_setpoints import (
    Done,
    is_halt_certain,
    may_stand,
    owe_halt,
    still_standing,
    voided,
)
from labweb.domain.runs.host_journal.action_states import ActionCandidate, HostState, decide_start
from labweb.domain.runs.states.job_states import JobState
from tests.simulation.memory import BEGINNING, Disk, MemoryWrite


def done(*actions: str | tuple[str, dict[str, Any]]) -> list[Done]:
    pairs = [one if isinstance(one, tuple) else (one, {}) for one in actions]
    return [Done(index=place, action=name, args=args) for place, (name, args) in enumerate(pairs)]


def test_set_points_and_what_a_halt_ends_are_unknown_and_nothing_else_is() -> None:
    known = {
        "temperature_setpoint_c": 0.0,
        "speed_setpoint_rpm": 400.0,
        "speed_rpm": 0.0,
        "is_pumping": False,
        "temperature_c": 60.1,
        "port_index": 3,
        "is_initialized": True,
    }
    gone = dict.fromkeys(
        ["is_pumping", "speed_rpm", "speed_setpoint_rpm", "temperature_setpoint_c"]
    )
    assert voided(known) == gone
    assert voided({**known, **gone}) == {}, "what is unknown is not made so again"


@pytest.mark.parametrize(
    ("actions", "left"),
    [
        (["stir", "heat_to"], [0, 1]),
        (["stir", "stir"], [1]),
        (["heat_to", ("hold", {"duration_s": 20.0})], [1]),
        (["stir", "heat_to", "stop_heating"], [0]),
        (["evacuate_to", "vent"], []),
        (["start_flow", "stop_flow", "start_flow"], [2]),
        ([("stir", {"duration_s": 60.0})], []),
        (["select_port", "aspirate", "initialize", "measure"], []),
        (["stop_stirring"], []),
        (
            [
                ("call", {"service": "spin"}),
                ("call", {"service": "home"}),
                ("call", {"service": "spin"}),
                ("run_goal", {"goal": "spin"}),
            ],
            [1, 2, 3],
        ),
    ],
)
def test_of_each_sort_the_last_action_that_was_not_ended_since_has_left_something(
    actions: list[Any], left: list[int]
) -> None:
    assert still_standing(done(*actions)) == left


@pytest.mark.parametrize(
    ("actions", "unknown", "left"),
    [
        (["stir"], {0}, [0]),
        ([("stir", {"duration_s": 60.0})], {0}, [0]),
        (["stir", "heat_to"], {0}, [0]),
        (["stir", "stop_stirring"], {0}, []),
        (["stir", "stop_stirring"], {0, 1}, [0]),
        (["stir", "stir"], {0}, []),
        (["stir", "stir"], {1}, [1]),
        (["stop_stirring", "select_port"], {0, 1}, []),
    ],
)
def test_what_was_given_up_may_stand_until_its_device_is_set_or_ended_again(
    actions: list[Any], unknown: set[int], left: list[int]
) -> None:
    told = [replace(one, is_known=one.index not in unknown) for one in done(*actions)]
    assert may_stand(told) == left


@pytest.mark.parametrize(
    ("halted_by", "offered"),
    [("edge.stopped", ["retry", "skip"]), ("let_go", []), ("", [])],
)
def test_what_was_done_is_done_again_only_where_a_halt_undid_it(
    halted_by: str, offered: list[str]
) -> None:
    job = Ended(
        index=0,
        state=JobState.COMPLETE,
        step_id="a",
        recovery="R1",
        has_moved=True,
        is_liquid=False,
        halted_by=halted_by,
    )
    found = choices_for(job, is_step_untouched=False)
    assert [one.name for one in found if not one.why_not] == offered


@pytest.mark.parametrize(
    "status",
    [
        "is_present",
        "is_connected",
        "is_door_open",
        "is_stable",
        "values",
        "feedback",
        "speed_setpoint_rpm",
        "temperature_c",
        "pressure_kpa",
        "mass_mg",
    ],
)
def test_what_is_the_same_of_a_device_that_moves_does_not_tell_that_it_stands(status: str) -> None:
    assert not tells_motion(status)


@pytest.mark.parametrize(
    ("status", "before", "now", "expected"),
    [
        ("speed_rpm", 400.0, 400.0, True),
        ("speed_rpm", 400.0, 0.0, False),
        ("flow_ul_s", 8.0, 8.0, True),
        ("is_running", True, True, True),
        ("is_pumping", True, False, False),
        ("volume_ul", 80.0, 80.0, False),
        ("volume_ul", 80.0, 79.0, True),
        ("port_index", 3, None, True),
    ],
)
def test_a_device_that_turns_evenly_does_not_stand(
    status: str, before: object, now: object, expected: bool
) -> None:
    assert tells_motion(status)
    assert is_moving(status, before, now) is expected


def test_only_what_a_foreign_node_was_asked_for_may_go_on_after_a_halt() -> None:
    asked = ["stir", "heat_to", "aspirate", "call", "run_goal"]
    assert [name for name in asked if not is_halt_certain(name)] == ["call", "run_goal"]


def a_disk() -> Disk:
    return Disk(UUID(int=1), UUID(int=2))


def owed(disk: Disk) -> dict[str, dict[str, str | None]]:
    found: dict[str, dict[str, str | None]] = json.loads(disk.meta.get("owed_halts", "{}"))
    return found


def test_the_first_cause_of_an_owed_halt_stays_and_the_first_action_that_waits_for_it() -> None:
    """A stop owes it first; the action that it cut off is asked about, and hears of it later."""
    disk, device = a_disk(), UUID(int=3)
    for code, action in (("edge.stopped", None), ("edge.halted", 4), ("edge.interrupted", 5)):
        with MemoryWrite(disk, BEGINNING, lambda _: None) as tx:
            owe_halt(tx, device, code, None if action is None else UUID(int=action))
    assert owed(disk) == {str(device): {"code": "edge.stopped", "action_id": str(UUID(int=4))}}


def test_what_was_too_old_to_start_says_that_its_device_owed_a_halt() -> None:
    host = HostState(
        host_id=UUID(int=1), epoch=1, floor=0, boot_id="b", armed_boot_id="b", stop_latched=False
    )
    late = ActionCandidate(
        dseq=1, max_fence=0, age_s=20.0, ttl_s=10.0, numbers_hold_s=None, owes_halt=True
    )
    answer = decide_start(host, late, findings=[], results=[])
    assert answer.code == "edge.expired"
    assert answer.message.endswith("; its device is still to be halted first")
