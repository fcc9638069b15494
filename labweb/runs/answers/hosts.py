"""What the acts on hosts answer with."""

from __future__ import annotations

from uuid import UUID

from labweb.common.answers import ApiAnswer
from labweb.domain.runs.host_link.host_session import SessionState


class HostStanding(ApiAnswer):
    """How a host stands after an act."""

    id: UUID
    state: SessionState
