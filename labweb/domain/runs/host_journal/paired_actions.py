"""Two actions of one host that begin at the same moment: a syringe pushes, the next one draws.

Between two syringes there is no vessel, and liquid cannot be compressed: one plunger alone would
burst a tube or draw gas. So both actions are started in one write or none is, each halts the other
when it fails, and the transfer is complete only once both devices have answered and been checked:

```text
giver    accepted ──────────▶ receiver ready? ─▶ both started ─▶ actuated ─▶ receiver complete? ─▶
receiver accepted ─▶ ready ───────────────────▶ started ──────▶ actuated ─▶ giver actuated? ──────▶
```

The giver comes first in the order of dispatch, has the operation on matter, and starts both: its
plunger moves a moment before the other one, so that no gas is drawn.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from enum import Enum
from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.errors import Effect
from labweb.domain.messages.commands import Do
from labweb.domain.runs.host_journal import action_states
from labweb.domain.runs.host_journal.action_states import (
    ActionReport,
    ActionState,
    HostAnswer,
    HostScene,
)
from labweb.domain.runs.host_journal.host_moment import HostMoment
from labweb.domain.runs.host_journal.journal_rows import ActionRow, JournalWrite

READY_S = 2.0
"""For how long what was read before an action counts while the other one is waited for."""

WAITS = "edge.meets"
"""Of a hold: what begins at the same moment is not ready."""


class Ready(msgspec.Struct, frozen=True, kw_only=True):
    """What a line found just before it would start its action; kept with it until both start."""

    boot_id: str
    mono_s: float
    scene: HostScene

    def is_fresh(self, at: HostMoment) -> bool:
        """Say whether it still counts."""
        return self.boot_id == at.boot_id and 0 <= at.mono_s - self.mono_s <= READY_S


class PairStand(Enum):
    """What the other action lets one do that its device has answered."""

    WAIT = "wait"
    GO_ON = "go_on"
    FAILED = "failed"


def partner_of(do: Do) -> UUID | None:
    """Return the action that begins at the same moment; None: it begins alone."""
    return None if do.batch is None else do.batch.meets


def check_pairs(members: Sequence[Do]) -> None:
    """Refuse a member that begins at the same moment as one that is not its own.

    Raises:
        ValueError: It names no other member, or that one does not name it, or both are one
            device's, or one waits for the other.
    """
    by_id = {do.action_id: do for do in members}
    for do in members:
        partner_id = partner_of(do)
        if partner_id is None:
            continue
        partner = by_id.get(partner_id)
        if partner is None or partner_of(partner) != do.action_id:
            raise ValueError("a member begins at the same moment as one that does not")
        if partner.device_id == do.device_id or (do.batch and partner_id in do.batch.after):
            raise ValueError("two members that begin at the same moment are of two devices")


def gives(row: ActionRow, partner: ActionRow) -> bool:
    """Say whether an action is the first of two that begin at the same moment."""
    return row.dseq < partner.dseq


def note_ready(tx: JournalWrite, row: ActionRow, at: HostMoment, scene: HostScene) -> None:
    """Keep that a receiver may start as soon as its giver may."""
    ready = Ready(boot_id=at.boot_id, mono_s=at.mono_s, scene=scene)
    kept: dict[str, Any] = msgspec.to_builtins(ready)
    tx.move(row.action_id, ActionState.ACCEPTED, ActionState.ACCEPTED, prestate=kept)


def withdraw(tx: JournalWrite, row: ActionRow) -> bool:
    """Take back that a receiver is ready; True: its giver has started both meanwhile."""
    state = tx.state_of(row.action_id)
    if state is ActionState.ACCEPTED:
        tx.move(row.action_id, ActionState.ACCEPTED, ActionState.ACCEPTED, prestate={})
    return state is ActionState.STARTED


def leave(tx: JournalWrite, waiting: Iterable[ActionRow], started: Iterable[ActionRow]) -> None:
    """Write down that a line has ended: none of its receivers is ready, none of its pairs acts.

    What was started together with an action of it is halted by its own line, at once.
    """
    for row in waiting:
        if partner_of(row.do) is not None:
            withdraw(tx, row)
    for row in started:
        halt_other(tx, row.do)


def may_act(row: ActionRow | None, partner: ActionRow | None) -> bool:
    """Say whether a receiver that was started may still send its first byte."""
    if row is None or row.is_cancel_wanted:
        return False
    acts = {ActionState.STARTED, ActionState.ACTUATED, ActionState.COMPLETE}
    return partner is not None and partner.st in acts


def not_sent() -> ActionReport:
    """Return the report of an action that has not sent a byte because the other one has failed."""
    text = "the action that moved at the same moment had failed before this one began"
    return ActionReport(ok=False, effect=Effect.NONE, code="edge.partner", message=text)


def readiness(row: ActionRow, at: HostMoment) -> Ready | None:
    """Return what a line found before its action, if it still counts; None: it is not ready."""
    try:
        found = msgspec.json.decode(row.prestate or "{}", type=Ready)
    except msgspec.MsgspecError:
        return None
    return found if found.is_fresh(at) else None


def gone(partner: ActionRow | None, row: ActionRow) -> HostAnswer | None:
    """Say why the other action will not start any more; None: it may."""
    if partner is not None and partner.st is ActionState.ACCEPTED:
        is_mutual = partner_of(partner.do) == row.action_id
        other = "the action that has to begin at the same moment names another one"
        return None if is_mutual else HostAnswer(action_states.REJECT, "edge.partner", other)
    where = "is not here" if partner is None else f"is {partner.st.value}"
    text = f"the action that has to begin at the same moment {where}"
    return HostAnswer(action_states.REJECT, "edge.partner", text)


def stand(row: ActionRow, partner: ActionRow | None) -> PairStand:
    """Say what the other action lets this one do, whose device has answered that all went well.

    The receiver goes on once the giver's device has answered too; the giver once the receiver is
    complete, with its conditions checked.
    """
    if partner is None:
        return PairStand.FAILED
    if partner.st is ActionState.COMPLETE:
        return PairStand.GO_ON
    if partner.st is ActionState.ACTUATED:
        return PairStand.WAIT if gives(row, partner) else PairStand.GO_ON
    return PairStand.WAIT if partner.st is ActionState.STARTED else PairStand.FAILED


def failed(report: ActionReport) -> ActionReport:
    """Return the report of an action that went well alone while the other one did not."""
    text = "the action that moved at the same moment failed: nobody knows where the liquid is"
    return replace(report, ok=False, effect=Effect.UNKNOWN, code="edge.partner", message=text)


def as_one_of_two(report: ActionReport) -> ActionReport:
    """Return what a failure of one of two plungers means: a part that moved is no known part."""
    if report.ok or report.effect is Effect.NONE:
        return report
    return replace(report, effect=Effect.UNKNOWN)


def halt_other(tx: JournalWrite, do: Do) -> None:
    """Have the other device halted when one of both has failed; its line does it."""
    partner_id = partner_of(do)
    if partner_id is not None and tx.state_of(partner_id) is ActionState.STARTED:
        tx.want_cancel(partner_id)
