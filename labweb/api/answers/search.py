"""What a search answers with."""

from __future__ import annotations

from typing import Literal
from uuid import UUID

from labweb.common.answers import ApiAnswer


class SearchHit(ApiAnswer):
    """One thing that was found by its name."""

    kind: Literal["resource", "device", "lot", "workflow", "run"]
    id: UUID
    name: str
    detail: str
    url: str
    """Page of the application that shows it."""


class SearchHits(ApiAnswer):
    """What was found, cut to the most that a search shows."""

    results: list[SearchHit]
