"""The same for the rules of batches and of trying anew; `batches.run` plays them."""

from __future__ import annotations

from dataclasses import replace

from labweb.domain.runs.after_failure import recovery_choices
from labweb.domain.runs.host_actions import host_batch, host_state
from labweb.domain.runs.host_actions.host_batch import BatchTurn
from labweb.domain.runs.host_journal.action_states import FINAL, ActionState, HostAnswer
from labweb.domain.runs.states.job_states import STEPS, JobState, Mover
from tests.simulation.host import SimHost
from tests.simulation.memory import MemoryWrite
from tests.simulation.mutants import Mutant, Patch


def batch_out_of_order(patch: Patch) -> None:
    """A member does not wait for what comes before it."""
    _turn(patch, lambda turn: replace(turn, before=()))


def batch_goes_on_after_a_failure(patch: Patch) -> None:
    """A member starts as soon as what comes before it has ended, however it ended."""
    done = ActionState.COMPLETE
    _turn(
        patch,
        lambda turn: replace(
            turn, before=tuple(done if one in FINAL else one for one in turn.before)
        ),
    )


def batch_goes_on_in_doubt(patch: Patch) -> None:
    """A member does not wait for the answer about what comes before it."""
    done = ActionState.COMPLETE
    _turn(
        patch,
        lambda turn: replace(
            turn,
            before=tuple(done if one is ActionState.IN_DOUBT else one for one in turn.before),
        ),
    )


def absence_is_nothing(patch: Patch) -> None:
    """The server may be away for ever, whatever the run declares."""
    patch.setattr(host_state, "offline_s", lambda state, at: None)


def leash_of_any_length(patch: Patch) -> None:
    """`continue` goes on though the server has been away for longer than allowed."""
    _turn(patch, lambda turn: replace(turn, offline_s=turn.offline_s and 0.0))


def nothing_is_stopped_safely(patch: Patch) -> None:
    """`stop_safe` neither halts nor gives back."""
    patch.setattr(host_state, "stop_safely", lambda tx: [])


def absence_without_an_event(patch: Patch) -> None:
    """That the server went away is a note that a copy of the journal takes back unseen."""
    real = MemoryWrite.append

    def append(self: MemoryWrite, kind: str, *rest: object) -> None:
        if kind != "link_lost":
            real(self, kind, *rest)  # type: ignore[arg-type]

    patch.setattr(MemoryWrite, "append", append)


def absence_left_unsealed(patch: Patch) -> None:
    """An absence that a dead process wrote down is taken as sealed."""
    real = SimHost.seal_up

    def seal_up(self: SimHost) -> None:
        if self.link is not None:
            real(self)

    patch.setattr(SimHost, "seal_up", seal_up)


def locks_free_between_members(patch: Patch) -> None:
    """What a later member needs is free as soon as an earlier one has ended."""
    patch.setattr(host_batch, "heirs", lambda held, claims: {})


def complete_is_tried_anew(patch: Patch) -> None:
    """A job that is complete may be tried anew."""
    step = (JobState.COMPLETE, JobState.QUEUED, Mover.PERSON)
    patch.setattr("labweb.domain.runs.states.job_states.STEPS", STEPS | {step})
    every = {*recovery_choices.UNDONE, JobState.COMPLETE}
    patch.setattr(recovery_choices, "may_retry", lambda state: state in every)


def _turn(patch: Patch, change: object) -> None:
    real = host_batch.decide_turn

    def decide(turn: BatchTurn) -> HostAnswer | None:
        return real(change(turn))  # type: ignore[operator]

    patch.setattr(host_batch, "decide_turn", decide)


OF_BATCHES: tuple[Mutant, ...] = (
    batch_out_of_order,
    batch_goes_on_after_a_failure,
    batch_goes_on_in_doubt,
    absence_is_nothing,
    leash_of_any_length,
    nothing_is_stopped_safely,
    absence_without_an_event,
    absence_left_unsealed,
    locks_free_between_members,
    complete_is_tried_anew,
)
