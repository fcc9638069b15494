"""What a call may fail with."""

from __future__ import annotations

from typing import Any

import msgspec


class LabwebError(Exception):
    """A call did not do what it was sent for."""


class CallUnansweredError(LabwebError):
    """No answer came, however often the call was sent with the same key.

    Whether the server has carried it out is not known; a call that only reads has changed nothing.
    To find out, send the same call with `key=error.key`: it is carried out once, and answered.
    """

    def __init__(self, message: str, key: str | None = None) -> None:
        super().__init__(message)
        self.key = key
        """Key of the call; None: it acts on nothing."""


class CallRefusedError(LabwebError):
    """The server refused a call, or failed at it."""

    def __init__(self, status: int, refusal: ServerRefusal) -> None:
        super().__init__(f"{refusal.message} ({refusal.code}, {status})")
        self.status = status
        self.code = refusal.code
        """The stable name of the reason; the server's documentation lists them."""

        self.effect = refusal.effect
        """`none`: nothing happened; `partial`; `unknown`: a person has to look."""

        self.context = refusal.context
        self.findings = refusal.findings


class ServerRefusal(msgspec.Struct):
    """The one shape of a refusal."""

    code: str
    message: str
    effect: str = "none"
    context: dict[str, Any] = msgspec.field(default_factory=dict)
    findings: list[dict[str, Any]] = msgspec.field(default_factory=list)
