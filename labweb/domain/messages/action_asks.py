"""Frames of the uplink by which nodes beside a host ask for an action of one of its devices.

Asking starts nothing at the host: the server plans it as a run of its own, in the name of the
person that an admin named for this host, and somebody has to approve it. What is then carried
out comes as a signed command, as always.
"""

from __future__ import annotations

from typing import Any
from uuid import UUID

import msgspec

MOST_ARGUMENTS_BYTES = 16 * 1024


class ActionAsk(msgspec.Struct, frozen=True, tag="ask", tag_field="t", kw_only=True):
    """Somebody who is not known wants an action of a device."""

    epoch: int
    ask_id: UUID
    """Chosen by who asks; the same one twice is one wish."""

    device_id: UUID
    action: str
    args: dict[str, Any]
    source: str
    """Where it came from, `ros2`."""


class WithdrawAsk(msgspec.Struct, frozen=True, tag="withdraw_ask", tag_field="t", kw_only=True):
    """It is not wanted any more."""

    epoch: int
    ask_id: UUID


class AskTold(msgspec.Struct, frozen=True, tag="ask_told", tag_field="t", kw_only=True):
    """What becomes of a wish."""

    ask_id: UUID
    state: str
    """`refused`, or the state of its job."""

    is_final: bool = False
    run_number: int = 0
    """0: there is no run."""

    message: str = ""
    evidence: dict[str, Any] = msgspec.field(default_factory=dict)
