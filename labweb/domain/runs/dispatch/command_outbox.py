"""When a command of the outbox is sent, and under which epoch."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from uuid import UUID

import msgspec

from labweb.domain.calibration.correction import holds_s
from labweb.domain.messages.commands import Command, Do, HostBatch, ResourceView, Tick
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.runs.host_link.host_session import SessionState

RING_AGAIN_AFTER_S = 2.0
"""A command that the host has not answered is rung again; the host drops repeats."""


def is_due(host: SessionState, sent_s_ago: float | None) -> bool:
    """Say whether an unanswered command is rung now; None: it was never sent.

    A host is online only when the server has read its whole log. What it has not answered
    by then, it never accepted: older epochs are void to it, so sending again is safe.
    """
    if host is not SessionState.ONLINE:
        return False
    return sent_s_ago is None or sent_s_ago >= RING_AGAIN_AFTER_S


class BatchDraft(msgspec.Struct, frozen=True, kw_only=True):
    """A batch as it waits in the outbox, before it is stamped and signed."""

    batch_id: UUID
    members: list[Do]
    resources: list[ResourceView]
    issued_by: str = ""


def signed_batch(
    draft: BatchDraft,
    epoch: int,
    sign: Callable[[Command], Signed],
    *,
    at: datetime,
    sent: Tick | None = None,
) -> HostBatch:
    """Stamp and sign each member, and put them together."""
    first = draft.members[0]
    return HostBatch(
        host_id=first.host_id,
        epoch=epoch,
        dseq=first.dseq,
        batch_id=draft.batch_id,
        members=[sign(stamped(do, epoch, at=at, sent=sent)) for do in draft.members],
        resources=draft.resources,
        issued_by=draft.issued_by,
    )


def stamped(command: Command, epoch: int, *, at: datetime, sent: Tick | None = None) -> Command:
    """Put on a command what is true right before it is signed.

    The epoch of the present session: written before a reconnect, the command is valid after it; a
    copy of it that was sent before the reconnect is void. And for how long its numbers hold from
    here on, with this moment by a clock that nobody sets: a host has no wall clock that anybody
    relies on, and the command may wait in the broker.
    """
    if isinstance(command, Do):
        left_s = holds_s(command.corrections, at)
        return msgspec.structs.replace(command, epoch=epoch, numbers_hold_s=left_s, sent=sent)
    return msgspec.structs.replace(command, epoch=epoch)
