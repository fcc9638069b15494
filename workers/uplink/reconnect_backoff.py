"""When the uplink tries again, and what it says of why there was no session.

What the two sides do not understand of each other is no matter of seconds: it is said once, and
tried again more and more seldom, until somebody has updated one of them.
"""

from __future__ import annotations

import logging
import random

import msgspec
from websockets.exceptions import ConnectionClosed

from labweb.domain.errors import LabError
from labweb.domain.messages.frames import CLOSE_BAD_FRAME

log = logging.getLogger(__name__)

FIRST_RETRY_S = 0.5
LONGEST_RETRY_S = 8.0
LONGEST_MISFIT_S = 300.0
"""Longest time between two tries of sides that do not understand each other."""


class SessionRefusedError(LabError):
    """The server will not open a session."""

    default_code = "host.refused"


class ReconnectBackoff:
    """How long to wait after each failure; twice as long after the next one, up to an end."""

    def __init__(self) -> None:
        self._pause_s = FIRST_RETRY_S
        self._misfit_s = LONGEST_RETRY_S
        self._said = ""

    def pause_s(self, error: Exception | None, url: str, lasted_s: float) -> float:
        """Say what went wrong, and return how long to wait.

        Args:
            error: What ended the try; None: the session came to its end.
            url: Where the server is.
            lasted_s: How long the try took, session and all.
        """
        if lasted_s > LONGEST_MISFIT_S:
            # They have understood each other meanwhile: what is wrong now is another matter.
            self._said = ""
        if error is not None and (text := misfit(error)):
            return self._after_misfit(text)
        if isinstance(error, SessionRefusedError):
            log.error("%s", error)
            # The connection of a process that died may close a moment later.
            if error.code != "host.rival":
                self._pause_s = LONGEST_RETRY_S
        elif isinstance(error, LabError):
            log.error("uplink stops until the cause is gone: %s", error)
        elif error is not None:
            log.warning("uplink to %s: %s", url, error)
        if lasted_s > LONGEST_RETRY_S:
            self._pause_s = FIRST_RETRY_S
        pause_s, self._pause_s = self._pause_s, min(self._pause_s * 2, LONGEST_RETRY_S)
        return _spread(pause_s)

    def _after_misfit(self, text: str) -> float:
        if text != self._said:
            log.error("%s; this is said once, and tried again every few minutes", text)
            self._said, self._misfit_s = text, LONGEST_RETRY_S
        pause_s, self._misfit_s = self._misfit_s, min(self._misfit_s * 2, LONGEST_MISFIT_S)
        return _spread(pause_s)


def misfit(error: Exception) -> str:
    """Say in what the two sides do not understand each other; empty: it is something else."""
    if isinstance(error, SessionRefusedError) and error.code == "host.version":
        return error.message
    if isinstance(error, msgspec.MsgspecError):
        return f"the server sends what this host does not know, one of them is older: {error}"
    if isinstance(error, ConnectionClosed):
        close = error.rcvd
        if close is not None and close.code == CLOSE_BAD_FRAME:
            said = f": {close.reason}" if close.reason else ""
            return f"the server does not know what this host sends, one of them is older{said}"
    return ""


def _spread(pause_s: float) -> float:
    return pause_s * random.uniform(0.5, 1.0)  # noqa: S311 - spreads load
