"""How an answer names what it does not describe."""

from __future__ import annotations

from uuid import UUID

from labweb.common.answers import ApiAnswer


class RunLabel(ApiAnswer):
    """A run by its number."""

    id: UUID
    number: int


class RunDevice(ApiAnswer):
    """A device that a run uses."""

    id: UUID
    name: str


class RunWorkflow(ApiAnswer):
    """The version of a workflow that a run carries out."""

    id: UUID
    name: str
    version: int
