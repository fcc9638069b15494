"""The same for the rules of halts; `halts.run` plays them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from labweb.domain.canonical_json import canonical
from labweb.domain.crutd import settlement
from labweb.domain.messages.stops import StopLabFrame
from labweb.domain.runs.halts import halted_setpoints
from labweb.domain.runs.host_actions import action_execution, host_state
from labweb.domain.runs.host_actions.action_execution import FoundDevice
from labweb.domain.runs.host_journal.action_states import HostState
from labweb.domain.runs.host_journal.journal_rows import ActionRow
from tests.simulation.halting import HaltingHost
from tests.simulation.memory import MemoryWrite
from tests.simulation.mutants import Mutant, Patch


def owed_halt_is_forgotten(patch: Patch) -> None:
    """A halt that was not delivered is not remembered."""
    patch.setattr(halted_setpoints, "_owe", lambda *_: None)


def owed_halt_in_memory(patch: Patch) -> None:
    """It is forgotten when the program starts again."""
    real = HaltingHost.start

    def start(self: HaltingHost, *, is_cold: bool) -> None:
        self.disk.meta.pop("owed_halts", None)
        real(self, is_cold=is_cold)

    patch.setattr(HaltingHost, "start", start)


def owed_halt_holds_nothing(patch: Patch) -> None:
    """A device that owes a halt acts all the same."""
    real = host_state.state_of

    def state_of(meta: dict[str, str], boot_id: str) -> HostState:
        found = real(meta, boot_id)
        return replace(found, owes_halt=frozenset())

    # The rule alone: who looks for what is owed still finds it.
    real_decide = action_execution.decide_now

    def decide(tx: MemoryWrite, row: ActionRow, *rest: Any) -> Any:  # noqa: ANN401 - as the rule
        with patch.context() as inner:
            inner.setattr("tests.simulation.memory.state_of", state_of)
            return real_decide(tx, row, *rest)

    patch.setattr(action_execution, "decide_now", decide)


def refused_halt_counts(patch: Patch) -> None:
    """A halt that a device did not confirm counts as delivered."""
    real = action_execution.recover

    def recover(tx: MemoryWrite, row: ActionRow, found: FoundDevice | None = None) -> bool:
        return real(tx, row, None if found is None else replace(found, is_owed=not found.is_halted))

    patch.setattr(action_execution, "recover", recover)


def stop_owes_nothing(patch: Patch) -> None:
    """A stop that is over before a line has heard of it has halted nothing."""
    real = halted_setpoints._owe

    def owe(tx: MemoryWrite, device_ids: Any, code: str, action_id: Any) -> None:  # noqa: ANN401
        if code != halted_setpoints.STOPPED:
            real(tx, device_ids, code, action_id)

    patch.setattr(halted_setpoints, "_owe", owe)


def stop_spares_what_acts(patch: Patch) -> None:
    """An action that is under way when the lab is stopped is not told."""
    real = host_state.write_stop

    def write_stop(tx: MemoryWrite, stop: StopLabFrame) -> None:
        with patch.context() as inner:
            inner.setattr(MemoryWrite, "want_cancel", lambda *_: None)
            real(tx, stop)

    patch.setattr(host_state, "write_stop", write_stop)


def last_cause_counts(patch: Patch) -> None:
    """A halt that is owed forgets why it was, and which action waits to hear of it."""
    real = halted_setpoints._owe

    def owe(tx: MemoryWrite, device_ids: Any, code: str, action_id: Any) -> None:  # noqa: ANN401
        wanted = list(device_ids)
        keys = set(map(str, wanted))
        kept = {key: due for key, due in halted_setpoints._owed(tx).items() if key not in keys}
        tx.set_meta("owed_halts", canonical(kept).decode())
        real(tx, wanted, code, action_id)

    patch.setattr(halted_setpoints, "_owe", owe)


def later_action_is_not_told(patch: Patch) -> None:
    """An action that is cut off when its device owes a halt already never hears of it."""
    real = halted_setpoints._owe

    def owe(tx: MemoryWrite, device_ids: Any, code: str, action_id: Any) -> None:  # noqa: ANN401
        wanted = [one for one in device_ids if str(one) not in halted_setpoints._owed(tx)]
        real(tx, wanted, code, action_id)

    patch.setattr(halted_setpoints, "_owe", owe)


def halt_voids_nothing(patch: Patch) -> None:
    """What a device was set to is taken to stand after a halt."""

    def voided(data: Mapping[str, Any]) -> dict[str, None]:
        return {}

    patch.setattr(halted_setpoints, "voided", voided)


def late_halt_voids_nothing(patch: Patch) -> None:
    """A halt that comes late ends what is owed and says nothing."""

    def write(tx: MemoryWrite, device_id: Any, *_: object) -> None:  # noqa: ANN401 - an id
        owed = halted_setpoints._owed(tx)
        if owed.pop(str(device_id), None) is not None:
            tx.set_meta("owed_halts", canonical(owed).decode())

    patch.setattr(halted_setpoints, "write_late_halt", write)


def given_up_and_kept(patch: Patch) -> None:
    """Where a person cannot tell either, the set-point before counts on."""
    patch.setattr(settlement, "given_up", lambda operation: {})


def interrupted_and_kept(patch: Patch) -> None:
    """What the successor of a line has halted is taken to be set as before."""
    real = action_execution.recover

    def recover(tx: MemoryWrite, row: ActionRow, found: FoundDevice | None = None) -> bool:
        return real(tx, row, None if found is None else replace(found, is_halted=False))

    patch.setattr(action_execution, "recover", recover)


def end_ignores_a_halt(patch: Patch) -> None:
    """An action that ends after its device was halted sets it on record."""
    patch.setattr(halted_setpoints, "was_halted", lambda tx, row: False)


def steps_stand_after_a_halt(patch: Patch) -> None:
    """A step counts as done though its device was halted since."""
    patch.setattr(halted_setpoints, "still_standing", lambda done: [])


OF_HALTS: tuple[Mutant, ...] = (
    owed_halt_is_forgotten,
    owed_halt_in_memory,
    owed_halt_holds_nothing,
    refused_halt_counts,
    stop_owes_nothing,
    stop_spares_what_acts,
    last_cause_counts,
    later_action_is_not_told,
    halt_voids_nothing,
    late_halt_voids_nothing,
    given_up_and_kept,
    interrupted_and_kept,
    end_ignores_a_halt,
    steps_stand_after_a_halt,
)
