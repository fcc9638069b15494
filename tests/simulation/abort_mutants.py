"""The same for the rules of aborts and of the stop of one device; `aborts.run` plays them."""

from __future__ import annotations

from typing import Any

import msgspec

from labweb.domain.messages.commands import Halt
from labweb.domain.runs.dispatch import job_scheduler
from labweb.domain.runs.halts import halted_setpoints
from labweb.domain.runs.states.job_states import RunState
from tests.simulation.memory import MemoryWrite
from tests.simulation.mutants import Mutant, Patch


def halt_is_not_owed(patch: Patch) -> None:
    """A host that has taken a halt does not write down that it owes it."""
    real = halted_setpoints.take_halt

    def take(tx: MemoryWrite, halt: Halt) -> bool:
        with patch.context() as inner:
            inner.setattr(halted_setpoints, "owe_halt", lambda *_: None)
            return real(tx, halt)

    patch.setattr(halted_setpoints, "take_halt", take)


def halt_is_taken_twice(patch: Patch) -> None:
    """A halt that comes again is carried out again."""
    real = halted_setpoints.take_halt

    def take(tx: MemoryWrite, halt: Halt) -> bool:
        with patch.context() as inner:
            inner.setattr(MemoryWrite, "is_first_refusal", lambda *_: True)
            return real(tx, halt)

    patch.setattr(halted_setpoints, "take_halt", take)


def stop_of_a_device_spares_what_acts(patch: Patch) -> None:
    """What acts at a device that is stopped is not told."""
    real = halted_setpoints.take_halt

    def take(tx: MemoryWrite, halt: Halt) -> bool:
        with patch.context() as inner:
            inner.setattr(MemoryWrite, "want_cancel", lambda *_: None)
            return real(tx, halt)

    patch.setattr(halted_setpoints, "take_halt", take)


def what_waits_begins_after_a_stop(patch: Patch) -> None:
    """A stop of a device by a person gives nothing back."""
    real = halted_setpoints.take_halt

    def take(tx: MemoryWrite, halt: Halt) -> bool:
        return real(tx, msgspec.structs.replace(halt, code=halted_setpoints.RUN_ABORTED))

    patch.setattr(halted_setpoints, "take_halt", take)


def nothing_stands(patch: Patch) -> None:
    """An abort cancels what was sent, and halts nothing that earlier steps have set."""
    patch.setattr("tests.simulation.aborting.AbortingServer._standing", lambda *_: [])


def what_was_given_up_stands(patch: Patch) -> None:
    """An abort halts nothing that an action may have set which a person has given up."""
    patch.setattr(halted_setpoints, "may_stand", lambda _: [])


def run_ends_before_its_halts(patch: Patch) -> None:
    """A run that was aborted ends though nothing is known of its devices."""
    real = job_scheduler.run_state

    def state(current: RunState, jobs: Any, **known: Any) -> RunState:  # noqa: ANN401 - as the rule
        return real(current, jobs, **{**known, "is_halting": False})

    patch.setattr(job_scheduler, "run_state", state)


def run_never_ends(patch: Patch) -> None:
    """A run that was aborted is never looked at again."""
    patch.setattr(job_scheduler, "_SETTLED", frozenset())


OF_ABORTS: tuple[Mutant, ...] = (
    halt_is_not_owed,
    halt_is_taken_twice,
    stop_of_a_device_spares_what_acts,
    what_waits_begins_after_a_stop,
    nothing_stands,
    what_was_given_up_stands,
    run_ends_before_its_halts,
    run_never_ends,
)
