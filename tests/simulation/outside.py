"""What a host of the simulation touches outside itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from labweb.domain.runs.host_actions.action_execution import Started
from labweb.domain.runs.host_journal.action_states import ActionReport
from labweb.domain.runs.host_journal.journal_rows import ActionRow

if TYPE_CHECKING:
    from tests.simulation.host import SimHost


class Lab(Protocol):
    """What a host touches outside itself."""

    now_s: float

    def started(self, host: SimHost, row: ActionRow) -> None:
        """Look at a start that is on disk."""

    def begin(self, host: SimHost, started: Started) -> None:
        """Send the first byte."""

    def finish(self, host: SimHost, started: Started) -> ActionReport:
        """Let the device answer."""

    def accepted(self, host: SimHost, row: ActionRow) -> None:
        """Look at what was journaled."""

    def link_lost(self, host: SimHost) -> None:
        """Look at what was written when the server went away."""

    def say(self, text: str) -> None:
        """Write a line of the trace."""
