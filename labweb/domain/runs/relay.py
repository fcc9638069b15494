"""When a command of the outbox is sent, and under which epoch."""

from __future__ import annotations

import msgspec

from labweb.domain.messages import Command
from labweb.domain.runs.session import SessionState

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


def stamped(command: Command, epoch: int) -> Command:
    """Put the epoch of the present session on a command, right before it is signed.

    Written before a reconnect, it is valid after it; a copy of it that was sent before the
    reconnect is void.
    """
    return msgspec.structs.replace(command, epoch=epoch)
